-- Why the archive cannot be used, as its sender found last; null: it can, or has not been tried.
ALTER TABLE archive ADD COLUMN problem TEXT;
ALTER TABLE archive ADD COLUMN problem_at REAL;
