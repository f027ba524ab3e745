// Values against time on a canvas: a lane for each unit, one above the other. Only new rows come; nothing is sent twice.
const GUTTER = 58, RIGHT = 10, FOOT = 24, GAP = 14, HEAD = 6;
const KEPT = 60000; // rows
const LEAST = 0.05; // s that the axis of time spans

const nice = (span, count) => {
  const raw = span / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].find((n) => n * power >= raw) * power;
};
const digits = (step) => Math.max(0, Math.min(4, -Math.floor(Math.log10(step) + 1e-9)));

export default {
  template: `<div class="sb-chart">
    <div class="sb-legend"><button v-for="(s, i) in series" type="button" :class="{off: off[i]}" :aria-pressed="!off[i]"
      @click="toggle(i)"><i :style="{background: s.colour}"></i>{{ s.label }}<b>{{ said[i] }}</b></button></div>
    <div class="sb-canvas" tabindex="0" role="img" :aria-label="label" @keydown="key" @pointerdown="down" @pointermove="move"
      @pointerup="up" @pointercancel="up" @pointerleave="leave" @wheel="wheel" @dblclick="reset"><canvas></canvas></div>
  </div>`,
  props: { series: Array, lanes: Array, seconds: Number, label: String },
  data: () => ({ off: [], said: [] }),
  created() {
    Object.assign(this, { rows: [], newest: 0, view: null, frozen: null, cursor: null, drag: null, marks: [], due: false, saidAt: 0 });
    this.clear();
  },
  mounted() {
    this.area = this.$el.querySelector(".sb-canvas");
    this.canvas = this.area.querySelector("canvas");
    this.sizes = new ResizeObserver(() => this.draw());
    this.sizes.observe(this.area);
    this.themes = new MutationObserver(() => this.draw());
    this.themes.observe(document.body, { attributes: true, attributeFilter: ["class"] });
    this.draw();
  },
  unmounted() {
    this.sizes.disconnect();
    this.themes.disconnect();
  },
  watch: {
    series() {
      this.clear();
    },
    seconds() {
      this.view = null;
      this.draw();
    },
  },
  methods: {
    clear() {
      this.rows = this.series.map(() => ({ t: [], y: [] })); // of each series: moments and values
      this.newest = 0;
      this.off = this.series.map(() => false);
      this.said = this.series.map(() => "");
      this.marks = [];
      this.view = this.frozen = this.cursor = null;
      this.draw();
    },
    push(rows) {
      for (const [t, values] of rows) {
        for (const [i, value] of Object.entries(values)) {
          if (!this.rows[i]) continue; // on its way when the channels changed
          this.rows[i].t.push(t);
          this.rows[i].y.push(value);
        }
        this.newest = t;
      }
      for (const { t, y } of this.rows)
        if (t.length > KEPT * 1.1) for (const list of [t, y]) list.splice(0, list.length - KEPT);
      this.draw();
    },
    pause(paused) {
      this.frozen = paused ? (this.frozen ?? this.newest) : null;
      if (!paused) this.view = null;
      this.draw();
    },
    mark(time, text) {
      this.marks.push([time, text]);
      this.draw();
    },
    toggle(i) {
      this.off[i] = !this.off[i];
      this.draw();
    },
    reset() {
      this.view = null;
      this.draw();
    },
    zoom(factor) {
      const [from, to] = this.span();
      this.around(factor, (from + to) / 2);
    },
    span() {
      if (this.view) return this.view;
      const last = this.frozen ?? this.newest;
      return [Math.max(last, this.seconds) - this.seconds, Math.max(last, this.seconds)];
    },
    visible() {
      return this.span();
    },
    around(factor, time) {
      const [from, to] = this.span();
      const width = Math.max((to - from) * factor, LEAST);
      const share = (time - from) / (to - from);
      this.view = [time - share * width, time + (1 - share) * width];
      this.draw();
    },
    // What the hand does: drag zooms to a stretch, a finger moves the cursor, the wheel zooms around it.
    time(event) {
      const box = this.area.getBoundingClientRect();
      const [from, to] = this.span();
      const share = (event.clientX - box.x - GUTTER) / (box.width - GUTTER - RIGHT);
      return from + Math.min(Math.max(share, 0), 1) * (to - from);
    },
    down(event) {
      if (event.button !== 0) return;
      this.area.setPointerCapture(event.pointerId);
      this.cursor = this.time(event);
      if (event.pointerType === "mouse") this.drag = [this.cursor, this.cursor];
      this.draw();
    },
    move(event) {
      this.cursor = this.time(event);
      if (this.drag) this.drag[1] = this.cursor;
      this.draw();
    },
    up() {
      if (this.drag) {
        const [from, to] = [...this.drag].sort((a, b) => a - b);
        const [left, right] = this.span();
        if (to - from > Math.max((right - left) * 0.01, LEAST)) this.view = [from, to];
      }
      this.drag = null;
      this.draw();
    },
    leave() {
      if (!this.drag) this.cursor = null;
      this.draw();
    },
    wheel(event) {
      if (!event.ctrlKey && !this.view && this.frozen === null) return; // the page scrolls; while it runs nothing is zoomed
      event.preventDefault();
      this.around(event.deltaY > 0 ? 1.25 : 0.8, this.time(event));
    },
    key(event) {
      const [from, to] = this.span();
      const step = (to - from) * (event.shiftKey ? 0.1 : 0.01);
      const here = this.cursor ?? (from + to) / 2;
      if (event.key === "ArrowLeft") this.cursor = Math.max(here - step, from);
      else if (event.key === "ArrowRight") this.cursor = Math.min(here + step, to);
      else if (event.key === "+") this.around(0.8, here);
      else if (event.key === "-") this.around(1.25, here);
      else if (event.key === "Home") this.reset();
      else return;
      event.preventDefault();
      this.draw();
    },
    // Drawing
    draw() {
      if (this.due || !this.canvas) return;
      this.due = true;
      requestAnimationFrame(() => {
        this.due = false;
        if (this.canvas?.isConnected) this.paint();
      });
    },
    index(t, time) {
      let [low, high] = [0, t.length];
      while (low < high) {
        const middle = (low + high) >> 1;
        if (t[middle] < time) low = middle + 1;
        else high = middle;
      }
      return low;
    },
    paint() {
      const [w, h] = [this.area.clientWidth, this.area.clientHeight];
      const ratio = window.devicePixelRatio || 1;
      if (this.canvas.width !== Math.round(w * ratio) || this.canvas.height !== Math.round(h * ratio)) {
        this.canvas.width = Math.round(w * ratio);
        this.canvas.height = Math.round(h * ratio);
      }
      const pen = this.canvas.getContext("2d");
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, w, h);
      this.picture(pen, w, h);
      this.say();
    },
    picture(pen, w, h) {
      const style = getComputedStyle(this.area);
      const [ink, faint] = [style.color, style.getPropertyValue("--sb-chart-grid").trim() || "#8884"];
      const [from, to] = this.span();
      const x = (t) => GUTTER + ((t - from) / (to - from)) * (w - GUTTER - RIGHT);
      const count = Math.max(this.lanes.length, 1);
      const height = (h - FOOT - HEAD - GAP * (count - 1)) / count;
      const parts = this.rows.map(({ t }) => [Math.max(this.index(t, from) - 1, 0), Math.min(this.index(t, to) + 1, t.length)]);
      pen.font = `11px ${style.fontFamily}`;
      pen.lineJoin = "round";
      const step = nice(to - from, (w - GUTTER) / 90);
      pen.textAlign = "center";
      pen.textBaseline = "alphabetic";
      for (let n = Math.ceil(from / step); n * step <= to; n++) {
        pen.fillStyle = faint;
        pen.fillRect(Math.round(x(n * step)), HEAD, 1, h - FOOT - HEAD);
        pen.fillStyle = ink;
        pen.fillText(`${(n * step).toFixed(digits(step))} s`, Math.min(x(n * step), w - 18), h - 7);
      }
      this.lanes.forEach((unit, lane) => {
        const top = HEAD + lane * (height + GAP);
        const mine = this.series.map((s, i) => i).filter((i) => this.series[i].lane === lane && !this.off[i]);
        const [low, high] = this.range(mine, parts);
        const y = (value) => top + height - ((value - low) / (high - low)) * height;
        this.scale(pen, w, top, height, low, high, y, unit, ink, faint);
        pen.save();
        pen.beginPath();
        pen.rect(GUTTER, top - 1, w - GUTTER - RIGHT, height + 2);
        pen.clip();
        for (const i of mine) this.line(pen, this.rows[i], this.series[i].colour, parts[i], x, y);
        pen.restore();
      });
      pen.textAlign = "left";
      for (const [time, text] of this.marks) {
        if (time < from || time > to) continue;
        pen.strokeStyle = pen.fillStyle = style.getPropertyValue("--sb-chart-mark").trim() || ink;
        pen.setLineDash([4, 4]);
        pen.strokeRect(Math.round(x(time)) + 0.5, HEAD, 0, h - FOOT - HEAD);
        pen.setLineDash([]);
        pen.fillText(text, x(time) + 5, HEAD + 10);
      }
      if (this.drag) {
        pen.fillStyle = faint;
        pen.fillRect(x(this.drag[0]), HEAD, x(this.drag[1]) - x(this.drag[0]), h - FOOT - HEAD);
      }
      if (this.cursor !== null && this.cursor >= from && this.cursor <= to) {
        pen.fillStyle = ink;
        pen.fillRect(Math.round(x(this.cursor)), HEAD, 1, h - FOOT - HEAD);
        const right = x(this.cursor) > w - 90;
        const text = this.drag ? `Δ ${Math.abs(this.drag[1] - this.drag[0]).toFixed(3)} s` : `${this.cursor.toFixed(3)} s`;
        pen.textAlign = right ? "right" : "left";
        pen.fillText(text, x(this.cursor) + (right ? -5 : 5), h - FOOT - 5);
      }
    },
    range(mine, parts) {
      let [low, high] = [Infinity, -Infinity];
      for (const i of mine) {
        for (let n = parts[i][0]; n < parts[i][1]; n++) {
          const value = this.rows[i].y[n];
          if (value === null) continue;
          if (value < low) low = value;
          if (value > high) high = value;
        }
      }
      if (low > high) return [0, 1];
      const room = Math.max((high - low) * 0.08, Math.abs(high) * 0.01, 0.05);
      return [low - room, high + room];
    },
    scale(pen, w, top, height, low, high, y, unit, ink, faint) {
      const step = nice(high - low, height / 34);
      pen.textAlign = "right";
      pen.textBaseline = "middle";
      for (let n = Math.ceil(low / step); n * step <= high; n++) {
        pen.fillStyle = faint;
        pen.fillRect(GUTTER, Math.round(y(n * step)), w - GUTTER - RIGHT, 1);
        pen.fillStyle = ink;
        pen.fillText((n * step).toFixed(digits(step)), GUTTER - 6, y(n * step));
      }
      pen.textBaseline = "alphabetic";
      pen.textAlign = "left";
      pen.font = pen.font.replace(/^/, "600 ");
      pen.fillText(unit, 2, top + 9);
      pen.font = pen.font.replace(/^600 /, "");
    },
    // Where a column of pixels has several rows, what is drawn is its lowest and highest: no peak is left out.
    line(pen, rows, colour, [first, last], x, y) {
      pen.strokeStyle = colour;
      pen.lineWidth = 1.6;
      pen.beginPath();
      let [open, column, low, high] = [false, NaN, 0, 0];
      const flush = () => {
        if (low !== high) {
          pen.lineTo(column, y(low));
          pen.lineTo(column, y(high));
        }
      };
      for (let n = first; n < last; n++) {
        const value = rows.y[n];
        if (value === null) {
          if (open) flush();
          open = false;
          continue;
        }
        const at = Math.round(x(rows.t[n]) * 2) / 2;
        if (!open) pen.moveTo(at, y(value));
        else if (at === column) {
          low = Math.min(low, value);
          high = Math.max(high, value);
          continue;
        } else {
          flush();
          pen.lineTo(at, y(value));
        }
        [open, column, low, high] = [true, at, value, value];
      }
      if (open) flush();
      pen.stroke();
      pen.lineWidth = 1;
    },
    say() {
      const now = performance.now();
      if (now - this.saidAt < 150 && this.cursor === null) return; // what changes faster cannot be read
      this.saidAt = now;
      const time = this.cursor ?? this.frozen ?? Infinity;
      this.said = this.series.map((s, i) => {
        const { t, y } = this.rows[i];
        const value = y[Math.min(this.index(t, time), t.length - 1)] ?? null;
        return value === null ? "–" : `${+value.toFixed(2)} ${this.lanes[s.lane]}`.trim();
      });
    },
    png(name) {
      const [w, h] = [this.area.clientWidth, this.area.clientHeight];
      const legend = 22;
      const canvas = document.createElement("canvas");
      const pen = canvas.getContext("2d");
      [canvas.width, canvas.height] = [w * 2, (h + legend) * 2];
      pen.scale(2, 2);
      pen.fillStyle = getComputedStyle(this.area).backgroundColor;
      pen.fillRect(0, 0, w, h + legend);
      pen.font = `12px ${getComputedStyle(this.area).fontFamily}`;
      let left = GUTTER;
      this.series.forEach((s, i) => {
        if (this.off[i]) return;
        pen.fillStyle = s.colour;
        pen.fillRect(left, 8, 10, 10);
        pen.fillStyle = getComputedStyle(this.area).color;
        pen.fillText(s.label, left + 14, 17);
        left += 32 + pen.measureText(s.label).width;
      });
      pen.translate(0, legend);
      this.picture(pen, w, h);
      canvas.toBlob((blob) => {
        const link = document.createElement("a");
        link.href = URL.createObjectURL(blob);
        link.download = name;
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 1000);
      });
    },
  },
};
