// The heartbeat of a tab, STOP, and the keys. Nothing here waits for the rest of the page.
//
// The server takes a tab for hung that does not beat for DEADMAN, and stops what the tab drives. The beat comes from the
// main thread on purpose: where the page hangs, it must end. A tab in the background is slowed down by the browser, and
// so lets go of what it drives.
(() => {
  const DEADMAN = 0.4, BEAT = 80, AGAIN = 500, TEXTS = "input, textarea, select, [contenteditable], [role=textbox]";
  let socket = null, sent = 0, delay = null, heard = 0;

  function show(state, text) {
    document.documentElement.dataset.link = state;
    const place = document.getElementById("sb-link");
    if (place && place.textContent !== text) place.textContent = text;
  }

  // NiceGUI forgets events that come before its own connection is there.
  function tellPage(id, tries = 0) {
    if (window.socket && window.socket.connected && typeof emitEvent === "function") emitEvent("servobus_live", id);
    else if (tries < 100) setTimeout(() => tellPage(id, tries + 1), 100);
  }

  function open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    socket = new WebSocket(`${scheme}//${location.host}/api/v1/live`);
    socket.onmessage = (event) => {
      const message = JSON.parse(event.data);
      heard = performance.now();
      if (message.k === "welcome") {
        if (message.role !== "viewer") send({ k: "hold", n: 1, deadman: DEADMAN });
        tellPage(message.connection);
      } else if (message.k === "beat") {
        delay = delay === null ? heard - sent : 0.9 * delay + 0.1 * (heard - sent);
        show("ok", delay < 1 ? "connected" : `connected, ${delay.toFixed(0)} ms`);
      } else if (message.k === "ok" && message.stopped !== undefined) stopped("ok");
      else if (message.k === "error" && message.n === 2) stopped("failed", message.error.message);
    };
    socket.onclose = () => { show("lost", "no connection"); delay = null; setTimeout(open, AGAIN); };
  }

  function send(message) {
    if (!socket || socket.readyState !== WebSocket.OPEN) return false;
    socket.send(JSON.stringify(message));
    return true;
  }

  setInterval(() => {
    if (!send({ k: "beat" })) return;
    sent = performance.now();
    if (heard && sent - heard > 1000) show("slow", "server is silent");
  }, BEAT);

  function stopped(state, text = "") {
    for (const button of document.querySelectorAll("[data-stop]")) button.dataset.stop = state;
    if (state !== "sent") setTimeout(() => stopped("sent"), 900);
    if (text) alert(text);
  }

  let last = -1000;
  function stop() {
    const now = performance.now();
    if (now - last < 150) return;
    last = now;
    stopped("asked");
    if (send({ k: "stop", n: 2 })) return;
    fetch("/api/v1/stop", { method: "POST", headers: { "Content-Type": "application/json" }, body: "{}" })
      .then(async (answer) => stopped(answer.ok ? "ok" : "failed", answer.ok ? "" : (await answer.json()).error.message))
      .catch(() => stopped("failed", "STOP did not reach the server. Switch off the supply of the servos."));
  }

  const pressed = (event) => event.target instanceof Element && event.target.closest("[data-stop]");
  // When the button goes down, not when it comes up again; a click without a pointer is the key Enter.
  addEventListener("pointerdown", (event) => { if (pressed(event)) stop(); }, true);
  addEventListener("click", (event) => { if (pressed(event) && event.detail === 0) stop(); }, true);
  addEventListener("keydown", (event) => {
    if (event.repeat) return;
    const typing = event.target instanceof Element && event.target.closest(TEXTS)
      && !event.target.matches("input[type=checkbox], input[type=radio], input[type=range], input[type=button]");
    if (event.key === "Escape") stop();
    else if (event.key === " " && !typing) { event.preventDefault(); stop(); }
  }, true);

  window.servobus = {
    stop,
    // By the clock of this page; for what is sent again and again while a button is held.
    alive: () => heard > 0 && performance.now() - heard < 1000 * DEADMAN,
    async ask(method, path, body) {
      const answer = await fetch(`/api/v1${path}`, { method, headers: { "Content-Type": "application/json" }, body: body && JSON.stringify(body) });
      return answer.json();
    },
    keepTheme(name) { document.cookie = `servobus_theme=${name}; path=/; max-age=31536000; SameSite=Strict`; },
  };
  open();
})();
