// All servos of a bus: cards, or lines where there are many. Each row draws itself, so that one which changes leaves
// the others alone.
import { h } from "vue";

const MANY = 24;

// An angle as a gauge: the middle of the range is on top, what grows goes clockwise. More than a turn is a full circle.
function dial(angle, goal, low, high, tone) {
  const round = low === null, middle = round ? 0 : (low + high) / 2, half = round ? 180 : Math.min((high - low) / 2, 180);
  const at = (degrees, radius) => {
    const a = ((degrees - 90) * Math.PI) / 180;
    return [50 + radius * Math.cos(a), 50 + radius * Math.sin(a)];
  };
  const arc = (from, to, radius) => {
    if (to - from >= 359.9) to = from + 359.9;
    const [x1, y1] = at(from, radius), [x2, y2] = at(to, radius);
    return `M${x1.toFixed(2)} ${y1.toFixed(2)}A${radius} ${radius} 0 ${to - from > 180 ? 1 : 0} 1 ${x2.toFixed(2)} ${y2.toFixed(2)}`;
  };
  const parts = [h("path", { d: arc(-half, half, 40), class: "sb-dial-track" })];
  const turn = (value) => (round ? ((value - middle + 180) % 360 + 360) % 360 - 180 : Math.max(-half, Math.min(half, value - middle)));
  const from = turn(round ? 0 : low <= 0 && high >= 0 ? 0 : low);
  if (angle !== null) {
    const now = turn(angle), [x, y] = at(now, 31);
    if (Math.abs(now - from) > 0.4) parts.push(h("path", { d: arc(Math.min(from, now), Math.max(from, now), 40), class: "sb-dial-fill" }));
    if (goal !== null && Math.abs(goal - angle) > 1) {
      const [gx, gy] = at(turn(goal), 40);
      parts.push(h("circle", { cx: gx, cy: gy, r: 5, class: "sb-dial-goal" }));
    }
    parts.push(h("line", { x1: 50, y1: 50, x2: x, y2: y, class: "sb-dial-hand" }), h("circle", { cx: 50, cy: 50, r: 4.5, class: "sb-dial-hub" }));
  }
  return h("svg", { viewBox: "0 0 100 100", class: ["sb-dial", tone], "aria-hidden": "true" }, parts);
}

const degrees = (value) => (value === null ? "–" : `${value.toFixed(1)}°`);
const chip = (text, tone, title) => h("span", { class: ["sb-chip", tone && `sb-chip-${tone}`], title }, text);

function state(row) {
  if (row.state === "lost") return chip("no answer", "bad", "The servo does not answer: look at its cable and its supply.");
  if (row.torque === "on") return chip("torque on", "accent");
  return row.torque ? chip(row.torque === "off" ? "torque off" : row.torque) : row.state === "waits" ? chip("asking") : null;
}

const tone = (row) => (row.state === "lost" || row.alarms.length ? "sb-is-bad" : row.torque === "on" ? "sb-is-on" : "");
const light = (row) => row.led === null ? null : h("span", { class: "sb-lamp", role: "img", title: row.led ? "light on" : "light off",
  "aria-label": row.led ? "light on" : "light off", style: row.led ? { background: row.led, color: row.led } : {} });
const value = (name, text, bad) => text ? h("div", { class: "sb-cell" }, [h("span", { class: "sb-cell-name" }, name), h("span", { class: ["sb-value", bad && "sb-warn"] }, text)]) : null;
const load = (row) => row.load === null ? null : h("div", { class: "sb-load", title: `load ${Math.round(row.load * 100)} %` },
  [h("i", { style: { left: `${50 + Math.min(0, row.load) * 50}%`, width: `${Math.min(1, Math.abs(row.load)) * 50}%` } })]);

const Servo = {
  props: ["row", "lines", "bus", "marked"],
  emits: ["toggle"],
  render() {
    const row = this.row, { lines, marked } = this;
    const link = `/servo?bus=${encodeURIComponent(this.bus)}&servo=${encodeURIComponent(row.key)}`;
    const box = h("input", { type: "checkbox", checked: marked, "aria-label": `mark ${row.name}`, onChange: () => this.$emit("toggle", row.key) });
    const name = h("a", { href: link, class: "sb-name" }, row.name);
    const alarms = row.alarms.map(([words, mend]) => h("div", { class: "sb-alarm", role: "alert" }, [h("b", words), lines ? null : h("span", mend)]));
    if (lines) {
      return h("div", { class: ["sb-line", tone(row), marked && "sb-marked"], role: "row", "data-key": row.key }, [
        box, h("span", { class: "sb-mini" }, [dial(row.angle, row.goal, row.low, row.high, "")]), h("span", { class: "sb-two" }, [name, h("small", `${row.model} · id ${row.id}`)]),
        h("span", { class: "sb-value sb-right" }, degrees(row.angle)), h("span", { class: "sb-value sb-right" }, row.speed),
        h("span", { class: "sb-far" }, [load(row)]), h("span", { class: ["sb-value sb-right", row.volts_bad && "sb-warn"] }, row.volts),
        h("span", { class: ["sb-value sb-right", row.temp_bad && "sb-warn"] }, row.temp),
        h("span", { class: "sb-status" }, [light(row), state(row), ...row.alarms.map(([words, mend]) => chip(words, "bad", mend))]),
      ]);
    }
    return h("article", { class: ["sb-card sb-wall-card", tone(row), marked && "sb-marked"], "data-key": row.key, "aria-label": row.name }, [
      h("header", [box, h("div", { class: "sb-two" }, [name, h("small", `${row.model} · id ${row.id}`)]), light(row)]),
      h("div", { class: "sb-body" }, [
        h("div", { class: "sb-face" }, [dial(row.angle, row.goal, row.low, row.high, tone(row)), h("span", { class: "sb-angle sb-value" }, degrees(row.angle))]),
        h("div", { class: "sb-cells" }, [value("Speed", row.speed), value("Supply", row.volts, row.volts_bad), value("Heat", row.temp, row.temp_bad),
          row.load === null ? null : h("div", { class: "sb-cell" }, [h("span", { class: "sb-cell-name" }, "Load"), load(row)])]),
      ]),
      ...alarms,
      h("footer", [state(row), h("small", { class: "sb-muted" }, row.line)]),
    ]);
  },
};

export default {
  props: { rows: Array, bus: String },
  emits: ["marked"],
  data() {
    return { kept: [], marks: {}, sought: "", view: this.stored() };
  },
  watch: {
    rows: { immediate: true, handler() { this.take(); } },
  },
  computed: {
    lines() { return this.view === "lines" || (this.view !== "cards" && this.kept.length > MANY); },
    seen() {
      const words = this.sought.toLowerCase().split(/\s+/).filter(Boolean);
      if (!words.length) return this.kept;
      return this.kept.filter((row) => {
        const text = `${row.name} ${row.model} id ${row.id} ${row.key} ${row.state} torque ${row.torque} ${row.alarms.length ? "alarm" : ""}`.toLowerCase();
        return words.every((word) => text.includes(word));
      });
    },
    count() { return Object.keys(this.marks).length; },
  },
  methods: {
    stored() { try { return localStorage.getItem("servobus_view") || ""; } catch { return ""; } },
    take() {
      this.kept = this.rows.map((row) => ({ ...row }));
      const known = new Set(this.kept.map((row) => row.key));
      for (const key of Object.keys(this.marks)) if (!known.has(key)) delete this.marks[key];
      this.tell();
    },
    patch(changes) {
      const rows = new Map(this.kept.map((row) => [row.key, row]));
      for (const [key, values] of changes) if (rows.has(key)) Object.assign(rows.get(key), values);
    },
    mark(keys) {
      this.marks = Object.fromEntries(keys.map((key) => [key, true]));
      this.tell();
    },
    toggle(key) {
      if (this.marks[key]) delete this.marks[key];
      else this.marks[key] = true;
      this.tell();
    },
    all() { this.mark(this.count && this.seen.every((row) => this.marks[row.key]) ? [] : this.seen.map((row) => row.key)); },
    tell() { this.$emit("marked", Object.keys(this.marks)); },
    look(view) {
      this.view = view;
      try { localStorage.setItem("servobus_view", view); } catch { /* a browser that keeps nothing */ }
    },
  },
  render() {
    const { lines } = this;
    const tab = (view, icon, label) => h("button", { type: "button", class: ["sb-wall-view", (view === "lines") === lines && "sb-wall-view-on"], "aria-pressed": String((view === "lines") === lines),
      title: label, "aria-label": label, onClick: () => this.look(view) }, [h("i", { class: "material-icons", "aria-hidden": "true" }, icon)]);
    const everything = this.seen.length > 0 && this.seen.every((row) => this.marks[row.key]);
    const bar = h("div", { class: "sb-wall-bar" }, [
      h("label", { class: "sb-tick" }, [h("input", { type: "checkbox", checked: everything, indeterminate: !everything && this.count > 0, onChange: () => this.all(), "aria-label": "mark all" }),
        h("span", this.count ? `${this.count} marked` : `${this.kept.length} servo${this.kept.length === 1 ? "" : "s"}`)]),
      h("input", { type: "search", class: "sb-search", placeholder: "Filter by name, model, id, alarm …", "aria-label": "Filter", value: this.sought, onInput: (event) => { this.sought = event.target.value; } }),
      h("div", { class: "sb-wall-views", role: "group", "aria-label": "View" }, [tab("cards", "grid_view", "Cards"), tab("lines", "view_list", "Lines")]),
    ]);
    const head = lines ? [h("div", { class: "sb-line sb-line-head", role: "row" }, ["", "", "Servo", "Angle", "Speed", "Load", "Supply", "Heat", ""].map((text, i) =>
      h("span", { role: "columnheader", class: [[3, 4, 6, 7].includes(i) && "sb-right", i === 5 && "sb-far"] }, text)))] : [];
    const rows = this.seen.map((row) => h(Servo, { key: row.key, row, lines, bus: this.bus, marked: Boolean(this.marks[row.key]), onToggle: this.toggle }));
    return h("div", { class: "sb-wall" }, [bar, this.seen.length || !this.kept.length ? h("div", { class: lines ? "sb-card sb-lines" : "sb-wall-cards", role: lines ? "table" : undefined }, [...head, ...rows])
      : h("p", { class: "sb-muted" }, "No servo fits this filter.")]);
  },
};
