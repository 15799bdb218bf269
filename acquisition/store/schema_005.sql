-- Sessions that run one after another: their order, and whether the next one may begin.
CREATE TABLE queue_entry (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    place REAL NOT NULL,
    object_name TEXT NOT NULL,
    recipe TEXT NOT NULL,
    unattended INTEGER NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('waiting', 'running', 'done', 'failed')),
    session_id TEXT REFERENCES session (id) ON DELETE SET NULL,
    idempotency_key TEXT UNIQUE,
    added_by TEXT NOT NULL,
    added_at REAL NOT NULL,
    ended_at REAL
) STRICT;

CREATE TABLE queue (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    state TEXT NOT NULL CHECK (state IN ('stopped', 'running')),
    reason TEXT,
    changed_by TEXT NOT NULL,
    changed_at REAL NOT NULL
) STRICT;
INSERT INTO queue VALUES (1, 'stopped', NULL, 'service', 0);
