/** Names of the API's schemas, from the types that openapi-typescript generates of `api/openapi.json`. */
import type { components } from "./api-types";

type Schemas = components["schemas"];

export type Caller = Schemas["CallerResource"];
export type Rig = Schemas["RigResource"];
export type Fault = Schemas["Fault"];
export type Session = Schemas["SessionResource"];
export type Recipe = Schemas["Recipe"];
export type Pass = Schemas["PassResource"];
export type PassSummary = Schemas["PassSummary"];
export type Plan = Schemas["LightPlan"];
export type Light = Schemas["Light"];
export type Shot = Schemas["Shot"];
export type Result = Schemas["ResultResource"];
export type Action = Schemas["ActionResource"];
export type Key = Schemas["KeyResource"];
export type Calibration = Schemas["RigCalibration"];
export type CalibrationKind = Schemas["CalibrationKindResource"];
export type CalibrationSet = Schemas["CalibrationSetResource"];
export type Estimate = Schemas["EstimateResource"];
export type TargetView = Schemas["TargetView"];
export type PlannedViews = Schemas["PlannedViews"];
export type DryRun = Schemas["DryRunResource"];
export type Queue = Schemas["QueueResource"];
export type QueueEntry = Schemas["QueueEntryResource"];
export type Vector3 = readonly [number, number, number];

/** One page of a list. */
export interface Page<T> {
  items: T[];
  next: string | null;
}

/** An event of the journal. Its `id` increases for ever. */
export interface JournalEvent {
  id: number;
  session_id: string | null;
  type: string;
  at: string;
  body: Record<string, unknown>;
}

/** A problem object (RFC 9457). */
export interface Problem {
  code: string;
  title: string;
  detail: string;
  remedy: string;
  status: number;
  errors?: { field: string; message: string }[];
}

/** A reading of the arm's joints, several times a second. */
export interface JointReading {
  connected: boolean;
  joints: number[] | null;
  moving: boolean | null;
  age_s: number | null;
  /** When it was sent, by the service's clock, ISO 8601. */
  at: string;
}
