// A list of packets that only ever grows at one end: new rows come one by one, old ones go, and nothing else is touched.
// All text is put in as text.
export default {
  template: `<div class="sb-log" tabindex="0" role="log" aria-label="Packets" @scroll="scrolled"><div ref="rows"></div></div>`,
  props: { most: Number },
  methods: {
    add(rows) {
      const list = this.$refs.rows, part = document.createDocumentFragment();
      for (const row of rows) part.appendChild(this.row(row));
      list.appendChild(part);
      while (list.childElementCount > this.most) list.firstElementChild.remove();
      if (this.follows !== false) this.$el.scrollTop = this.$el.scrollHeight;
    },
    replace(rows) {
      this.$refs.rows.replaceChildren();
      this.follows = true;
      this.add(rows);
    },
    scrolled() {
      this.follows = this.$el.scrollTop + this.$el.clientHeight > this.$el.scrollHeight - 24;
    },
    row([time, by, direction, servo, text, hex, latency, look]) {
      const row = document.createElement("div");
      row.className = `sb-log-row ${look}`;
      const put = (name, content) => {
        const cell = document.createElement("span");
        cell.className = name;
        cell.textContent = content;
        row.appendChild(cell);
      };
      put("sb-log-time", time);
      put("sb-log-by", by);
      put("sb-log-way", direction);
      put("sb-log-servo", servo);
      put("sb-log-text", text);
      put("sb-log-late", latency);
      put("sb-log-hex", hex);
      return row;
    },
  },
};
