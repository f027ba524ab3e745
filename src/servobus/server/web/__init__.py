"""The web process: pages and an API for people and programs, on top of the asynchronous driver.

    guard     stands around everything: Host, origin, login, role, size, rate, security headers
    auth      who has logged in, and with which rights
    service   what can be asked of buses and servos, by the API and by pages alike
    api       those functions under /api/v1
    app       all of it as one ASGI application

The web process owns no port for long and keeps nothing that must not be lost: what it serves goes on without it.
"""
