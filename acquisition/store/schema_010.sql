-- Identity of the archive, as its sender found it last; '': it has none; null: nobody has looked yet.
ALTER TABLE archive ADD COLUMN identity TEXT;
