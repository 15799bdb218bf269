-- Resuming reads a session's own events.
CREATE INDEX event_of_session ON event (session_id, type, id);
