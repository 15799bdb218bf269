/** The recipe's JSON schema as the service publishes it, reduced to what a form needs. */
import { get } from "../connection/requests";

export interface Field {
  name: string;
  kind: "choice" | "number" | "integer" | "text" | "long-text" | "yes-no" | "lights" | "group";
  /** Whether the field may be empty (null). */
  optional: boolean;
  explanation: string;
  otherwise: unknown;
  choices?: string[];
  least?: number;
  most?: number;
  longest?: number;
  fields?: Field[];
}

interface Schema {
  type?: string;
  const?: unknown;
  enum?: string[];
  default?: unknown;
  description?: string;
  minimum?: number;
  exclusiveMinimum?: number;
  maximum?: number;
  maxLength?: number;
  $ref?: string;
  anyOf?: Schema[];
  properties?: Record<string, Schema>;
}

/** Texts that may be longer than this get several lines. */
const LONG_TEXT = 500;

let known: Promise<Record<string, Schema>> | null = null;

/** A recipe's fields in the schema's order, without its kind and those with a single possible value. */
export async function recipeFields(recipe = "Recipe"): Promise<Field[]> {
  known ??= get<{ components: { schemas: Record<string, Schema> } }>("/openapi.json").then(
    ({ components }) => components.schemas,
  );
  known.catch(() => (known = null));
  const schemas = await known;
  return fieldsOf(schemas[recipe]!, schemas).filter(({ name }) => name !== "kind");
}

function fieldsOf(schema: Schema, schemas: Record<string, Schema>): Field[] {
  return Object.entries(schema.properties ?? {}).flatMap(([name, property]) => {
    if (property.const !== undefined) return [];
    const named = (one: Schema): Schema => (one.$ref ? schemas[one.$ref.split("/").at(-1)!]! : one);
    const inner = named(property);
    const present = named(inner.anyOf?.find((one) => one.type !== "null") ?? inner);
    const least = present.minimum ?? present.exclusiveMinimum;
    return [
      {
        name,
        kind: kindOf(present),
        optional: inner.anyOf?.some((one) => one.type === "null") ?? false,
        explanation: property.description ?? inner.description ?? "",
        otherwise: property.default,
        ...(present.enum ? { choices: present.enum } : {}),
        ...(least === undefined ? {} : { least }),
        ...(present.maximum === undefined ? {} : { most: present.maximum }),
        ...(present.maxLength === undefined ? {} : { longest: present.maxLength }),
        ...(present.properties ? { fields: fieldsOf(present, schemas) } : {}),
      },
    ];
  });
}

function kindOf(schema: Schema): Field["kind"] {
  if (schema.enum) return "choice";
  if (schema.properties) return "group";
  if (schema.type === "array") return "lights";
  if (schema.type === "boolean") return "yes-no";
  if (schema.type === "integer" || schema.type === "number") return schema.type;
  return (schema.maxLength ?? 0) > LONG_TEXT ? "long-text" : "text";
}
