/** The calibration in use: its validity, and its values in words and numbers. */
import { html, type TemplateResult } from "lit";
import { customElement, state } from "lit/decorators.js";
import { JournalController } from "../connection/live";
import { get } from "../connection/requests";
import type { Calibration } from "../connection/schemas";
import { PageElement } from "./element";
import { saidOf } from "./problem";
import { number, percent, t, when } from "../words/language";

const DAY_MS = 86_400_000;
/** Pause before values that could not be read are requested again, ms. */
const RETRY_MS = 2_000;

type Row = readonly [name: string, value: string | TemplateResult];

@customElement("calibration-values")
export class CalibrationValues extends PageElement {
  @state() private calibration: Calibration | null = null;
  @state() private failed: unknown = null;
  protected readonly hearing = new JournalController(this, ({ type }) => {
    if (type === "calibration.activated") void this.load();
  });

  override connectedCallback(): void {
    super.connectedCallback();
    void this.load();
  }

  private async load(): Promise<void> {
    try {
      this.calibration = await get<Calibration>("/v1/rig/calibration");
      this.failed = null;
    } catch (error) {
      this.failed = error;
      setTimeout(() => this.isConnected && void this.load(), RETRY_MS);
    }
  }

  override render() {
    const { calibration } = this;
    return html`${this.failed ? saidOf(this.failed, "reading") : calibration ? this.shown(calibration) : html`<p role="status">${t("loading")}</p>`}`;
  }

  private shown(calibration: Calibration) {
    const left = number((Date.parse(calibration.valid_until) - Date.now()) / DAY_MS, 0);
    return html`<p class=${calibration.valid ? "notice good" : "notice danger"}>
        ${calibration.valid ? t("calibration.valid", { days: left }) : t("calibration.invalid")}
      </p>
      <dl class="figures">
        <div>
          <dt>${t("calibration.made")}</dt>
          <dd class="words">${when(calibration.made_at)}</dd>
        </div>
        <div>
          <dt>${t("calibration.age")}</dt>
          <dd>${t("calibration.days", { days: number(calibration.age_days, 0) })}</dd>
        </div>
        <div>
          <dt>${t("calibration.until")}</dt>
          <dd class="words">${when(calibration.valid_until)}</dd>
        </div>
        <div>
          <dt>${t("calibration.file")}</dt>
          <dd class="words"><code>${calibration.file}</code></dd>
        </div>
      </dl>
      <div class="split">
        ${values("camera", cameraOf(calibration))} ${values("lamp", lampOf(calibration))}
        ${values("noise", noiseOf(calibration))}
      </div>
      <p class="caption">
        ${t("calibration.fingerprint")}: <code class="fingerprint">${calibration.fingerprint}</code>
      </p>`;
  }
}

function values(group: "camera" | "lamp" | "noise", rows: readonly Row[]) {
  const label = t(`calibration.${group}`);
  return html`<section class="card" aria-labelledby=${`calibration-${group}`}>
    <h2 id=${`calibration-${group}`}>${label}</h2>
    <div class="scrolled" tabindex="0" role="group" aria-label=${label}>
      <table class="list values" id=${`${group}-values`}>
        <tbody>
          ${rows.map(
            ([name, value]) =>
              html`<tr>
                <th scope="row">${name}</th>
                <td>${value}</td>
              </tr>`,
          )}
        </tbody>
      </table>
    </div>
  </section>`;
}

function cameraOf({ values: known }: Calibration): Row[] {
  const [[fx, , cx], [, fy, cy]] = known.camera_matrix;
  const opening = (2 * Math.atan(known.width / 2 / fx) * 180) / Math.PI;
  return [
    [t("calibration.size"), `${known.width} × ${known.height} px`],
    [
      t("calibration.focal"),
      `${number(fx, 1)}, ${number(fy, 1)} px (${t("calibration.opening")} ${number(opening, 1)}°)`,
    ],
    [t("calibration.centre"), `${number(cx, 1)}, ${number(cy, 1)} px`],
    [t("calibration.distortion"), known.distortion.map((one) => number(one, 4)).join(", ")],
    [t("calibration.camera_position"), millimetres(known.base_from_camera)],
    [t("calibration.camera_axis"), axis(known.base_from_camera)],
  ];
}

function lampOf({ values: known }: Calibration): Row[] {
  const half = (Math.acos(0.5 ** (1 / Math.max(known.lobe_exponent, 1e-9))) * 180) / Math.PI;
  return [
    [t("calibration.lamp_position"), millimetres(known.tool_from_lamp)],
    [t("calibration.lamp_axis"), axis(known.tool_from_lamp)],
    [t("calibration.lobe"), `${number(known.lobe_exponent, 2)} (${t("calibration.half", { angle: number(half, 0) })})`],
    [
      t("calibration.intensity"),
      t("calibration.intensity_value", {
        value: number(known.lamp_intensity, 2),
        distance: number(1e3 * known.reference_m, 0),
      }),
    ],
  ];
}

function noiseOf({ values: { sensor, ...known } }: Calibration): Row[] {
  return [
    [t("calibration.intensity_sigma"), percent(known.intensity_sigma, 1)],
    [t("calibration.position_sigma"), `${number(1e3 * known.lamp_position_sigma_m, 2)} mm`],
    [t("calibration.bits"), `${sensor.bits} bit, ${t("calibration.black")} ${number(sensor.black_level_dn, 1)} DN`],
    [t("calibration.gain"), `${number(sensor.gain_e_per_dn, 2)} e⁻/DN`],
    [t("calibration.read_noise"), `${number(sensor.read_noise_e, 1)} e⁻`],
    [t("calibration.full_well"), `${number(sensor.full_well_e, 0)} e⁻`],
  ];
}

/** Formats the position of a pose, mm. */
function millimetres(pose: readonly (readonly number[])[]): string {
  return `${pose
    .slice(0, 3)
    .map((row) => number(1e3 * row[3]!, 1))
    .join(", ")} mm`;
}

/** Formats the direction of a pose's z axis. */
function axis(pose: readonly (readonly number[])[]): string {
  return pose
    .slice(0, 3)
    .map((row) => number(row[2], 3))
    .join(", ");
}
