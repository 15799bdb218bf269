/**
 * The value of a number field, written into it only if another number stands there: while a person types "0.", the number
 * is 0 already, and writing "0" would erase the point. An unfinished "-" or "1e" is left alone, too.
 */
import { noChange } from "lit";
import { Directive, directive, type PropertyPart } from "lit/directive.js";

class NumberIn extends Directive {
  override render(value: unknown): string {
    return value === null || value === undefined ? "" : String(value);
  }

  override update({ element }: PropertyPart, [value]: [unknown]): unknown {
    const field = element as HTMLInputElement;
    const written = this.render(value);
    const same =
      field.value === "" || written === "" ? field.value === written : Number(field.value) === Number(written);
    // A field that cannot be read as a number is empty to scripts.
    if (!same) field.value = written;
    return noChange;
  }
}

export const numberIn = directive(NumberIn);
