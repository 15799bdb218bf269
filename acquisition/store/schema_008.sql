-- Further frames of a light, which are merged with its first one.
CREATE TABLE wider (
    session_id TEXT NOT NULL REFERENCES session (id) ON DELETE CASCADE,
    pass_number INTEGER NOT NULL,
    number INTEGER NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('light', 'dark', 'reference', 'bracket')),
    body TEXT NOT NULL,
    PRIMARY KEY (session_id, pass_number, number)
) STRICT;
INSERT INTO wider SELECT * FROM shot ORDER BY rowid;
DROP TABLE shot;
ALTER TABLE wider RENAME TO shot;
