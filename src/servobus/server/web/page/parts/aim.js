// A dial on which a goal is set: the range of a servo, the limits set in it, where it is and where it is to go. Radians.
const R = 84;
const point = (angle, radius) => [radius * Math.sin(angle), -radius * Math.cos(angle)];
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

export default {
  template: `<svg class="sb-aim" :class="{disabled}" viewBox="-110 -96 220 196" role="slider" :tabindex="disabled ? -1 : 0"
    :aria-label="label" :aria-valuemin="deg(low)" :aria-valuemax="deg(high)" :aria-valuenow="deg(goal ?? position ?? low)"
    :aria-disabled="disabled" @pointerdown="down" @pointermove="move" @pointerup="up" @pointercancel="up" @keydown="key">
    <path class="range" :d="arc(least, most)" /><path class="allowed" :d="arc(low, high)" />
    <line v-for="t in ticks" class="tick" :x1="t[0]" :y1="t[1]" :x2="t[2]" :y2="t[3]" />
    <path v-if="goal !== null && position !== null" class="way" :d="arc(Math.min(goal, position), Math.max(goal, position))" />
    <g v-if="position !== null" class="here" :transform="turned(position)"><path d="M-5 -30 L0 -72 L5 -30 Z" /></g>
    <g v-if="goal !== null" :transform="turned(goal)"><circle class="goal" cy="-84" r="9" /></g>
    <text class="now" y="6">{{ position === null ? "–" : deg(position) + "°" }}</text>
    <text class="to" y="26">{{ goal === null ? "" : "→ " + deg(goal) + "°" }}</text>
    <text class="end" :x="ends[0]" :y="ends[1]">{{ deg(low, 0) }}°</text>
    <text class="end" :x="ends[2]" :y="ends[3]">{{ deg(high, 0) }}°</text>
  </svg>`,
  props: { low: Number, high: Number, least: Number, most: Number, disabled: Boolean, label: String },
  data: () => ({ position: null, goal: null }),
  computed: {
    middle() {
      return (this.least + this.most) / 2;
    },
    whole() {
      return Math.max(this.most - this.least, 1e-6);
    },
    ticks() {
      const step = this.whole > 7 ? Math.PI / 2 : Math.PI / 6;
      const found = [];
      for (let n = Math.ceil(this.least / step - 1e-6); n * step <= this.most + 1e-6; n++)
        found.push([...point(this.shown(n * step), 66), ...point(this.shown(n * step), 72)]);
      return found;
    },
    ends() {
      return [...point(this.shown(this.low), 102), ...point(this.shown(this.high), 102)];
    },
  },
  created() {
    this.pointer = null;
    this.told = 0;
  },
  methods: {
    // Several turns are drawn on one: the range takes 300 degrees then.
    shown(angle) {
      const scale = this.whole > 2 * Math.PI ? 5.24 / this.whole : 1;
      return (angle - this.middle) * scale;
    },
    turned(angle) {
      return `rotate(${(this.shown(angle) * 180) / Math.PI})`;
    },
    deg(angle, digits = 1) {
      return ((angle * 180) / Math.PI).toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1");
    },
    arc(from, to) {
      const [a, b] = [this.shown(from), this.shown(to)];
      if (b - a >= 2 * Math.PI - 1e-3) return `M0 ${-R} A${R} ${R} 0 1 1 0 ${R} A${R} ${R} 0 1 1 0 ${-R}`;
      const [x1, y1] = point(a, R);
      const [x2, y2] = point(b, R);
      return `M${x1} ${y1} A${R} ${R} 0 ${b - a > Math.PI ? 1 : 0} 1 ${x2} ${y2}`;
    },
    see(position) {
      this.position = position;
    },
    set_goal(goal) {
      if (this.pointer === null) this.goal = goal;
    },
    at(event) {
      const box = this.$el.getBoundingClientRect();
      let turn = Math.atan2(event.clientX - box.x - box.width / 2, -(event.clientY - box.y - (box.height * 96) / 196));
      const scale = this.whole > 2 * Math.PI ? 5.24 / this.whole : 1;
      let angle = this.middle + turn / scale;
      // Near the gap at the bottom the pointer may cross to the other side: the goal stays at its end.
      if (this.goal !== null && Math.abs(angle - this.goal) * scale > Math.PI) angle = this.goal > this.middle ? this.high : this.low;
      return clamp(angle, this.low, this.high);
    },
    down(event) {
      if (this.disabled || event.button !== 0) return;
      this.$el.setPointerCapture(event.pointerId);
      this.pointer = event.pointerId;
      this.goal = null;
      this.aim(this.at(event), false);
    },
    move(event) {
      if (event.pointerId === this.pointer) this.aim(this.at(event), false);
    },
    up(event) {
      if (event.pointerId !== this.pointer) return;
      this.pointer = null;
      this.aim(this.goal, true);
    },
    key(event) {
      const step = (event.shiftKey ? 10 : 1) * (Math.PI / 180);
      const from = this.goal ?? this.position ?? this.low;
      const goals = {
        ArrowRight: from + step, ArrowUp: from + step, ArrowLeft: from - step, ArrowDown: from - step,
        PageUp: from + 0.1745, PageDown: from - 0.1745, Home: this.low, End: this.high,
      };
      if (this.disabled || !(event.key in goals)) return;
      event.preventDefault();
      this.aim(clamp(goals[event.key], this.low, this.high), true);
    },
    aim(goal, done) {
      this.goal = goal;
      const now = performance.now();
      if (!done && now - this.told < 50) return; // the newest counts
      this.told = now;
      this.$emit("aim", { goal, done });
    },
  },
};
