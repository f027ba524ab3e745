"""The page for a browser that has not logged in: it exchanges the token of its link, or asks for the password.

The token is used by a script of the page and not by opening the address, for browsers and chat programs open addresses
to look at them beforehand. The script takes it out of the address bar, too.

A link is good once. Opened again in the same browser it leads on all the same: the cookie is there, at the latest when
the script asks. Opened where the cookie is not, the page says where a new link is to be had.
"""

from collections.abc import Mapping
from urllib.parse import parse_qs, quote

from starlette.types import Scope, Send

PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>servobus</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><meta name="color-scheme" content="light dark">
<style>body {{ font: 1rem/1.5 system-ui, sans-serif; max-width: 32rem; margin: 15vh auto 0; padding: 0 1rem }}
input, button {{ font: inherit; padding: .4rem .7rem }} [hidden] {{ display: none }}</style></head>
<body><h1>servobus</h1><p id="said" role="status">Logging in ...</p>
<form id="form" hidden><label>Password <input id="password" type="password" autocomplete="current-password" required>
</label> <button>Log in</button></form>
<div id="help" hidden><p>This page needs a link that logs this browser in. Each link is good once.</p>
<p>The program that runs <code>servobus serve</code> prints one when it starts. A browser that is logged in already can
make another one.</p></div>
<noscript><p>This page needs JavaScript.</p></noscript>
<script nonce="{nonce}">
const said = document.getElementById('said'), form = document.getElementById('form');
const token = new URLSearchParams(location.search).get('token');
const here = location.origin + location.pathname;
history.replaceState(null, '', here);
async function enter(what) {{
  const answer = await fetch('/api/v1/session', {{
    method: 'POST', headers: {{'Content-Type': 'application/json'}}, body: JSON.stringify(what)}});
  if (answer.ok) {{ location.replace(here); return; }}
  let text = 'The server does not answer as it should.';
  try {{ text = (await answer.json()).error.message; }} catch (error) {{ }}
  ask(text);
}}
function ask(text) {{
  said.textContent = text;
  form.hidden = !{has_password};
  document.getElementById('help').hidden = {has_password};
}}
form.addEventListener('submit', event => {{
  event.preventDefault();
  enter({{password: document.getElementById('password').value}});
}});
if (token) enter({{token}}).catch(() => ask('The server does not answer.'));
else ask({has_password} ? 'Log in to go on.' : 'This browser has not logged in.');
</script></body></html>
"""


def has_token(scope: Scope) -> bool:
    """Tell whether somebody follows a link that logs in."""
    given = scope["method"] == "GET" and not scope["path"].startswith("/api/")
    return given and "token" in parse_qs(scope["query_string"].decode("latin-1"))


def is_page(method: str, path: str, headers: Mapping[bytes, bytes]) -> bool:
    """Tell whether a person waits for the answer."""
    return method == "GET" and not path.startswith("/api/") and b"text/html" in headers.get(b"accept", b"")


async def answer(send: Send, nonce: str, *, has_password: bool) -> None:
    """Give the page."""
    body = PAGE.format(nonce=nonce, has_password="true" if has_password else "false").encode()
    headers = [(b"content-type", b"text/html; charset=utf-8"), (b"content-length", f"{len(body)}".encode())]
    await send({"type": "http.response.start", "status": 401, "headers": headers})
    await send({"type": "http.response.body", "body": body})


async def move_on(send: Send, path: str) -> None:
    """Lead a browser that is logged in to the address without the token."""
    place = "/" + quote(path.lstrip("/\\"))
    headers = [(b"location", place.encode("ascii")), (b"content-length", b"0")]
    await send({"type": "http.response.start", "status": 303, "headers": headers})
    await send({"type": "http.response.body", "body": b""})
