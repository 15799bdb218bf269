"""The archive: sessions of many cells at one address, solved again whenever the solver improves.

push → list, show, verify → solve → export. Files are content-addressed (`contents`), what belongs to a session or to a
result is a manifest (`entries`), and a catalogue in SQL finds them (`catalogue`, `where`). The manifests are the truth:
a lost catalogue is read from them again. A solve is identified by session, solver version and settings, and claimed in
the catalogue (`claims`), so that whoever asks, however often and from wherever, each is solved once; Dask distributes
the work and may forget all of it (`distributed`). Whether the servers answer at all is asked before any of it is
imported (`answering`).

Nothing here is imported by a service that was given no archive, and nothing is in the path of motion. Needs the extra
`archive`.
"""
