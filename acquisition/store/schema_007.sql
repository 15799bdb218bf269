-- The archive that ended sessions are handed on to; no row: there is none.
CREATE TABLE archive (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    address TEXT NOT NULL
) STRICT;

-- What the archive has of each session: up to which event, or why nothing yet.
CREATE TABLE outbox (
    session_id TEXT PRIMARY KEY REFERENCES session (id) ON DELETE CASCADE,
    state TEXT NOT NULL CHECK (state IN ('waiting', 'archived')),
    event_id INTEGER NOT NULL,
    key TEXT,
    tries INTEGER NOT NULL,
    next_try_at REAL NOT NULL,
    reason TEXT,
    changed_at REAL NOT NULL
) STRICT;

-- Completed sessions with an event that the archive has not seen: their end, a further result, a new label.
CREATE VIEW awaiting_archive AS
SELECT session.id AS session_id, session.ended_at AS ended_at, newest.id AS event_id,
    coalesce(outbox.tries, 0) AS tries, coalesce(outbox.next_try_at, 0) AS next_try_at
FROM session
JOIN (
    SELECT session_id, max(id) AS id FROM event
    WHERE type NOT IN ('session.archived', 'session.archive_failed') GROUP BY session_id
) AS newest ON newest.session_id = session.id
LEFT JOIN outbox ON outbox.session_id = session.id
WHERE session.state = 'completed' AND (outbox.state IS NULL OR outbox.state = 'waiting' OR outbox.event_id < newest.id);
