"""The HTTP door: a FastAPI application over the job queue, with server-rendered pages. `service.http.app.create_app` makes it."""
