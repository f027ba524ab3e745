"""Headers that every answer carries, and the nonce that lets the scripts of a page run and no others.

The policy is the strictest under which pages of NiceGUI run: their templates are compiled in the browser, which needs
'unsafe-eval', and their styles stand inline. NiceGUI writes no nonce by itself; the text of elements is escaped in its
pages, so a `<script` in one is one of its own.
"""

import re

from starlette.types import Message, Send

STRICT = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
PAGE = (
    "default-src 'none'; script-src 'self' 'nonce-{nonce}' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; font-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
COMMON = {
    b"x-content-type-options": b"nosniff",
    b"x-frame-options": b"DENY",
    b"referrer-policy": b"no-referrer",
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"permissions-policy": b"camera=(), geolocation=(), microphone=(), usb=(), serial=()",
}
PAGE_MARK = (b"x-nicegui-content", b"page")
_TAG = re.compile(rb"<(script|link(?=[^>]*rel=[\"']?modulepreload))\b", re.IGNORECASE)


def protected(send: Send, nonce: str, path: str) -> Send:
    """Have every answer carry the headers, and none that lets pages of others read it."""
    assets = path.startswith("/_nicegui/")

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = [(name.lower(), value) for name, value in message.get("headers", [])]
            kept = [
                (name, value)
                for name, value in given
                if not name.startswith(b"access-control-")
                and name not in (*COMMON, b"content-security-policy", b"server")
            ]
            html = any(name == b"content-type" and value.startswith(b"text/html") for name, value in given)
            policy = PAGE.format(nonce=nonce) if html else STRICT
            extra = {**COMMON, b"content-security-policy": policy.encode()}
            if not assets:
                kept = [(name, value) for name, value in kept if name != b"cache-control"]
                extra[b"cache-control"] = b"no-store"
            message = {**message, "headers": [*kept, *extra.items()]}
        await send(message)

    return guarded


def with_nonces(send: Send, nonce: str) -> Send:
    """Write the nonce into the scripts of a page of NiceGUI; everything else goes through as it comes."""
    start: Message | None = None
    parts: list[bytes] = []

    async def marked(message: Message) -> None:
        nonlocal start
        if message["type"] == "http.response.start":
            headers = [(name.lower(), value) for name, value in message.get("headers", [])]
            if PAGE_MARK in headers:
                start = message
                return
        elif start is not None and message["type"] == "http.response.body":
            parts.append(message.get("body", b""))
            if message.get("more_body", False):
                return
            page = _TAG.sub(rb'<\1 nonce="' + nonce.encode() + rb'"', b"".join(parts))
            headers = [(name, value) for name, value in start["headers"] if name.lower() != b"content-length"]
            headers.append((b"content-length", f"{len(page)}".encode()))
            await send({**start, "headers": headers})
            await send({"type": "http.response.body", "body": page})
            return
        await send(message)

    return marked
