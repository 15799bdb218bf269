"""The archive for reading: a page at `/archive` and its resources, in the service or in a separate server.

Nothing here writes to an archive. A cell's service has these routes if its settings name an archive. Without a cell,
`lightpose archive serve` serves them alone. They need the extra `archive`, so a service imports them only then.
"""
