/** Answers of the archive's routes (`api/rest/archive_page/schemas.py`). */

export interface ArchivedSession {
  key: string;
  session_id: string;
  object: string;
  notes: string;
  cell: string;
  kind: string;
  lights: number;
  width: number;
  height: number;
  bytes: number;
  captured: string | null;
  pushed: string;
  calibration: string;
  software: string;
  solver: string | null;
  sigma_deg: number | null;
  links: { self: string; picture: string; export: string };
}

export interface ArchivedFile {
  path: string;
  bytes: number;
}

export interface ArchivedResult {
  solver: string;
  settings: string;
  last_pass: number | null;
  state: "done" | "claimed" | "failed";
  origin: "cell" | "archive";
  solved: string | null;
  sigma_deg: number | null;
  moved_mean_deg: number | null;
  moved_over_sigma: number | null;
  error: string | null;
  files: ArchivedFile[];
  links: Record<string, string>;
}

export interface ArchivedSessionDetails extends ArchivedSession {
  files: ArchivedFile[];
  results: ArchivedResult[];
}
