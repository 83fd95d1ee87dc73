"""The front doors: the `luxmeter` command line."""
