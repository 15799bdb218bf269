-- A calibration session's estimates.
CREATE TABLE wider (
    id INTEGER PRIMARY KEY,
    session_id TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,
    kind TEXT NOT NULL CHECK (kind IN ('plan', 'route', 'result', 'region', 'estimate')),
    number INTEGER NOT NULL,
    path TEXT NOT NULL,
    sha256 TEXT NOT NULL,
    body TEXT NOT NULL,
    created_at REAL NOT NULL
) STRICT;
INSERT INTO wider SELECT * FROM artifact;
DROP TABLE artifact;
ALTER TABLE wider RENAME TO artifact;
CREATE INDEX artifact_of_session ON artifact (session_id, kind, number, id);
