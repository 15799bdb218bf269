-- Label and notes that a person gave after the session was created; null: those of its recipe.
ALTER TABLE session ADD COLUMN label TEXT;
ALTER TABLE session ADD COLUMN notes TEXT;
