/**
 * The recipe as a form, made from its schema: a field that a later release adds appears here with its explanation.
 *
 * Only this page knows which fields a newcomer needs first, and which have no meaning beside others.
 */
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { PageElement } from "../parts/element";
import { exact, t, tOr } from "../words/language";
import { numberIn } from "./number-in";
import type { Field } from "./recipe-schema";

export type Values = Record<string, unknown>;

const FIRST = [
  ...["label", "pilot_lights", "planned_lights", "target_sigma_deg", "max_lights", "review_plan"],
  ...["max_images", "target_mm", "target_px", "notes"],
];

/** Whether a field has a meaning beside the values of the others. */
const MATTERS: Record<string, (values: Values) => boolean> = {
  planned_lights: (values) => values["target_sigma_deg"] == null && values["method"] !== "user",
  pilot_lights: (values) => values["method"] !== "user",
  target_sigma_deg: (values) => values["method"] === "optimal",
  max_lights: (values) => values["target_sigma_deg"] != null,
  review_plan: (values) => values["method"] === "optimal",
  slant_deg: (values) => values["method"] === "ring",
  user_lights: (values) => values["method"] === "user",
  target_mm: (values) => values["kind"] !== "camera",
};

/** Opens the section of an invalid value: a browser reports nothing about a value that is folded away. */
const OPEN_FOR_INVALID = {
  capture: true,
  handleEvent: (event: Event): void => {
    (event.currentTarget as HTMLDetailsElement).open = true;
  },
};

@customElement("recipe-form")
export class RecipeForm extends PageElement {
  @property({ attribute: false }) fields: Field[] = [];
  @property({ attribute: false }) values: Values = {};
  /** The service's messages about single fields, by dotted name. */
  @property({ attribute: false }) errors: Record<string, string> = {};

  override render() {
    const rest = this.fields.filter((field) => !FIRST.includes(field.name));
    // Enter in a field activates a form's first button. As this one is disabled, it does nothing: the arm must not begin
    // to move because a label was typed, or scanned.
    return html`<button disabled hidden></button>
      ${FIRST.map((name) => this.fields.find((field) => field.name === name)).map((field) =>
        field ? this.field(field, this.values, field.name) : nothing,
      )}
      <details @invalid=${OPEN_FOR_INVALID}>
        <summary>${t("start.more")}</summary>
        ${rest.map((field) => this.field(field, this.values, field.name))}
      </details>`;
  }

  private field(field: Field, values: Values, path: string): TemplateResult | typeof nothing {
    if (MATTERS[path] && !MATTERS[path](this.values)) return nothing;
    const label = tOr(`recipe.${path}`, path);
    if (field.kind === "group")
      return html`<fieldset>
        <legend>${label}</legend>
        ${field.fields!.map((inner) => this.field(inner, (values[field.name] ?? {}) as Values, `${path}.${inner.name}`))}
      </fieldset>`;
    const id = `recipe-${path}`;
    const explanation = this.explanation(field, path);
    const error = this.errors[path];
    return html`<div class=${`field${field.kind === "yes-no" ? " tick" : ""}${/text/.test(field.kind) ? " wide" : ""}`}>
      <label for=${id}>${label}</label>
      ${this.input(field, values[field.name], path, id)}
      ${explanation ? html`<small id=${`${id}-help`}>${explanation}</small>` : nothing}
      ${error ? html`<p class="error" role="alert">${error}</p>` : nothing}
    </div>`;
  }

  /** The page's own words if there are any, else the schema's, with the range. */
  private explanation(field: Field, path: string): string {
    const words = tOr(`explain.${path}`, field.explanation);
    const { least, most } = field;
    const range = least === undefined || most === undefined || most > 1e6 ? "" : `${exact(least)}–${exact(most)}`;
    return [words, range].filter(Boolean).join(" · ");
  }

  private input(field: Field, value: unknown, path: string, id: string) {
    const help = `${id}-help`;
    const put = (next: unknown): void => this.put(path, next);
    const text = (event: Event): string => (event.target as HTMLInputElement).value;
    switch (field.kind) {
      case "choice":
        return html`<select id=${id} aria-describedby=${help} @change=${(event: Event) => put(text(event))}>
          ${field.choices!.map(
            (choice) =>
              html`<option value=${choice} ?selected=${choice === value}>${tOr(`choice.${choice}`, choice)}</option>`,
          )}
        </select>`;
      case "yes-no":
        return html`<input
          id=${id}
          type="checkbox"
          aria-describedby=${help}
          .checked=${value === true}
          @change=${(event: Event) => put((event.target as HTMLInputElement).checked)}
        />`;
      case "number":
      case "integer":
        return html`<input
          id=${id}
          type="number"
          aria-describedby=${help}
          step=${field.kind === "integer" ? "1" : "any"}
          min=${field.least ?? nothing}
          max=${field.most ?? nothing}
          ?required=${!field.optional}
          .value=${numberIn(value)}
          @input=${(event: Event) => put(text(event) === "" ? null : Number(text(event)))}
        />`;
      case "lights":
        return html`<textarea
          id=${id}
          rows="5"
          aria-describedby=${help}
          placeholder="0.12 0.05 -0.47"
          .value=${written(value)}
          @change=${(event: Event) => put(read(text(event)))}
        ></textarea>`;
      default:
        return field.kind === "long-text"
          ? html`<textarea
              id=${id}
              rows="3"
              maxlength=${field.longest ?? nothing}
              .value=${String(value ?? "")}
              @input=${(event: Event) => put(text(event))}
            ></textarea>`
          : html`<input
              id=${id}
              type="text"
              maxlength=${field.longest ?? nothing}
              .value=${String(value ?? "")}
              @input=${(event: Event) => put(text(event))}
            />`;
    }
  }

  private put(path: string, value: unknown): void {
    const [first, second] = path.split(".") as [string, string | undefined];
    const next = second ? { ...(this.values[first] as Values), [second]: value } : value;
    const values = { ...this.values, [first]: next };
    if (first === "target_sigma_deg") values["planned_lights"] = value === null ? 4 : 0;
    this.dispatchEvent(new CustomEvent("values", { detail: values }));
  }
}

function written(lights: unknown): string {
  return ((lights ?? []) as number[][]).map((light) => light.join(" ")).join("\n");
}

function read(text: string): number[][] {
  return text
    .split("\n")
    .map((line) => line.trim())
    .filter(Boolean)
    .map((line) => line.split(/[\s,;]+/).map(Number));
}
