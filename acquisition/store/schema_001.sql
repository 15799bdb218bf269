CREATE TABLE session (
    id TEXT PRIMARY KEY,
    number INTEGER NOT NULL UNIQUE,
    state TEXT NOT NULL CHECK (state IN ('created', 'running', 'pausing', 'paused', 'stopping', 'interrupted',
                                         'completed', 'stopped', 'failed')),
    recipe TEXT NOT NULL,
    cell TEXT NOT NULL,
    fingerprint TEXT NOT NULL,
    idempotency_key TEXT UNIQUE,
    reason TEXT,
    created_at REAL NOT NULL,
    started_at REAL,
    ended_at REAL
) STRICT;

-- One session at a time may hold the rig.
CREATE UNIQUE INDEX one_holder ON session ((1)) WHERE state IN ('running', 'pausing', 'paused', 'stopping', 'interrupted');

CREATE TABLE shot (
    session_id TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,
    pass_number INTEGER NOT NULL,
    number INTEGER NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('light', 'dark', 'reference')),
    body TEXT NOT NULL,
    PRIMARY KEY (session_id, pass_number, number)
) STRICT;

CREATE TABLE artifact (
    id INTEGER PRIMARY KEY,
    session_id TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,
    kind TEXT NOT NULL CHECK (kind IN ('plan', 'route', 'result')),
    number INTEGER NOT NULL,
    path TEXT NOT NULL,
    sha256 TEXT NOT NULL,
    body TEXT NOT NULL,
    created_at REAL NOT NULL
) STRICT;
CREATE INDEX artifact_of_session ON artifact (session_id, kind, number, id);

CREATE TABLE action (
    id INTEGER PRIMARY KEY,
    session_id TEXT REFERENCES session (id) ON DELETE CASCADE,
    action TEXT NOT NULL,
    actor TEXT NOT NULL,
    outcome TEXT NOT NULL,
    at REAL NOT NULL
) STRICT;

CREATE TABLE event (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    session_id TEXT,
    type TEXT NOT NULL,
    body TEXT NOT NULL,
    at REAL NOT NULL
) STRICT;

CREATE TABLE safety (
    id INTEGER PRIMARY KEY,
    code TEXT NOT NULL,
    detail TEXT NOT NULL,
    since REAL NOT NULL,
    acknowledged_by TEXT,
    acknowledged_at REAL
) STRICT;
