"""The archive: sessions of many cells at one address, solved again whenever the solver improves.

The order of use is push → list, show, verify → solve → export. Files are content-addressed (`contents`). A manifest
lists the files of a session or of a result (`entries`), and a catalogue in SQL finds them (`catalogue`, `where`). The
manifests are the truth: a lost catalogue is read from them again. A solve is identified by session, solver version and
settings, and claimed in the catalogue (`claims`), so that each is solved once, however often and from wherever it is
requested. Dask distributes the work and may forget all of it (`distributed`). Before any of this is imported,
`answering` checks that the servers answer.

A service without an archive imports only `sender_process` from here, and nothing here takes part in motion. Needs the
extra `archive`.
"""
