"""The engine: evaluations and their nodes as DBOS workflows. The one package that knows DBOS.

`client`: what a process that does no work asks of it. `engine`: runs workflows in this process. `workflows`: what runs.
`recovery`: whose work is what, and the one call into DBOS's own parts. `station`: what the workflows of this process work with.
`wire`: names, limits, version.
"""
