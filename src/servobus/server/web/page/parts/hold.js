// A button that says again and again that it is held. Its end need not be told: whoever listens stops when nothing comes.
const BEAT = 60; // ms, as in jogging.py
const REPEAT = 800; // ms: a key that is held repeats sooner; where it does not, its release was lost

export default {
  template: `<button type="button" class="sb-hold" :class="{held}" :disabled="disabled" :aria-label="label"
    @pointerdown="down" @pointerup="end" @pointercancel="end" @lostpointercapture="end"
    @keydown="key" @keyup="end" @blur="end" @contextmenu.prevent><slot></slot></button>`,
  props: { label: String, disabled: Boolean },
  data: () => ({ held: false }),
  created() {
    this.number = 0;
    this.timer = null;
  },
  mounted() {
    this.leave = () => this.end();
    window.addEventListener("blur", this.leave);
    document.addEventListener("visibilitychange", this.leave);
  },
  unmounted() {
    this.end();
    window.removeEventListener("blur", this.leave);
    document.removeEventListener("visibilitychange", this.leave);
  },
  methods: {
    down(event) {
      if (event.button !== 0) return;
      event.currentTarget.setPointerCapture(event.pointerId);
      this.begin();
    },
    key(event) {
      if (event.key !== "Enter") return;
      event.preventDefault();
      this.repeated = performance.now();
      if (!this.held) this.begin(true);
    },
    begin(byKey = false) {
      if (this.held || this.disabled) return;
      this.held = true;
      const beat = () => {
        if (document.hidden || (byKey && performance.now() - this.repeated > REPEAT)) return this.end();
        this.$emit("held", { number: this.number++, sent: performance.now() / 1000 });
      };
      beat();
      this.timer = setInterval(beat, BEAT);
    },
    end() {
      if (!this.held) return;
      this.held = false;
      clearInterval(this.timer);
      this.$emit("released", {});
    },
  },
};
