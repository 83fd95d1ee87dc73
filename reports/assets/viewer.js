"use strict";
// Image viewer on float data: two images side by side, with a slider or flipped, and their error maps. Works from disk: the data come
// as scripts that call luxmeter.image (a page opened from disk may not fetch files).

const luxmeter = (() => {
  const ASSETS = document.currentScript.dataset.assets ?? "assets"; // a page elsewhere says where the folder lies
  const LUMA = [0.2126, 0.7152, 0.0722];
  const MODES = [["side", "Side by side"], ["slider", "Slider"], ["flip", "Flip"], ["relative", "Relative error"], ["over", "Over 2 %"]];
  const STATES = [["within 2 %", [38, 44, 56]], ["over 2 %", [213, 94, 0]], ["undecided: the reference is too noisy", [86, 180, 233]]];
  const loaded = new Map();
  const pending = new Map();

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

  function image(id, data) {
    const over = Object.fromEntries(Object.entries(data.over).map(([key, text]) => [key, bytes(text)]));
    loaded.set(id, { id, width: data.width, height: data.height, rgb: new Float32Array(bytes(data.rgb).buffer), over, cache: new Map() });
  }

  function load(id) {
    if (!pending.has(id)) {
      pending.set(id, new Promise((resolve, reject) => {
        const script = document.createElement("script");
        script.src = `${ASSETS}/data/${encodeURIComponent(id)}.js`;
        script.onload = () => resolve(loaded.get(id));
        script.onerror = () => reject(new Error(`no data for ${id}`));
        document.head.append(script);
      }));
    }
    return pending.get(id);
  }

  const luminance = (rgb, i) => LUMA[0] * rgb[3 * i] + LUMA[1] * rgb[3 * i + 1] + LUMA[2] * rgb[3 * i + 2];

  // The shortest decimal that reads back as the same float32.
  function shortest(value) {
    for (let digits = 1; digits < 9; digits++) {
      const text = value.toPrecision(digits);
      if (Math.fround(Number(text)) === value) return String(Number(text));
    }
    return String(Number(value.toPrecision(9)));
  }

  function picture(owner, key, paint) {
    if (!owner.cache.has(key)) {
      const canvas = document.createElement("canvas");
      canvas.width = owner.width;
      canvas.height = owner.height;
      const context = canvas.getContext("2d");
      const pixels = context.createImageData(owner.width, owner.height);
      for (let i = 3; i < pixels.data.length; i += 4) pixels.data[i] = 255;
      paint(pixels.data);
      context.putImageData(pixels, 0, 0);
      if (owner.cache.size > 3) owner.cache.delete(owner.cache.keys().next().value);
      owner.cache.set(key, canvas);
    }
    return owner.cache.get(key);
  }

  function toned(source, exposure) {
    return picture(source, `tone ${exposure}`, (out) => {
      for (let i = 0, n = source.width * source.height; i < n; i++) {
        for (let c = 0; c < 3; c++) {
          const v = Math.min(Math.max(source.rgb[3 * i + c] * exposure, 0), 1);
          out[4 * i + c] = 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
        }
      }
    });
  }

  function meanLuminance(source) {
    if (source.mean === undefined) {
      const n = source.width * source.height;
      let sum = 0;
      for (let i = 0; i < n; i++) sum += luminance(source.rgb, i);
      source.mean = sum / n;
    }
    return source.mean;
  }

  function relativeError(test, reference, i) {
    const r = luminance(reference.rgb, i), d = luminance(test.rgb, i) - r, floor = r + 0.01 * meanLuminance(reference);
    return floor > 0 ? d / floor : Math.sign(d);
  }

  function relativeMap(test, reference, range) {
    return picture(test, `relative ${reference.id} ${range}`, (out) => {
      for (let i = 0, n = test.width * test.height; i < n; i++) {
        const e = Math.min(Math.max(relativeError(test, reference, i) / range, -1), 1), t = Math.abs(e);
        const end = e < 0 ? [0, 90, 181] : [200, 80, 0];
        for (let c = 0; c < 3; c++) out[4 * i + c] = 242 + (end[c] - 242) * t;
      }
    });
  }

  function overMap(test, reference) {
    return picture(test, `over ${reference.id}`, (out) => {
      test.over[reference.id].forEach((state, i) => STATES[state][1].forEach((v, c) => { out[4 * i + c] = v; }));
    });
  }

  function element(name, attributes = {}, ...children) {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  }

  class Viewer {
    constructor(place, data) {
      this.data = data;
      this.state = { frame: 0, a: "", b: "", mode: "side", stops: 0, range: 0.25, zoom: 1, x: 0.5, y: 0.5, split: 0.5, flipped: false, probe: null };
      this.canvas = element("canvas", { tabindex: "0", role: "img", "aria-label": "Image viewer. Arrow keys move the probed pixel, plus and minus zoom, square brackets change the exposure, F flips, 1 to 5 choose the mode, 0 resets." });
      this.readout = element("output", { class: "readout" });
      this.key = element("div", { class: "key" });
      this.pictures = element("div", { class: "pictures" });
      place.replaceChildren(this.controls(), this.canvas, this.readout, this.key, this.pictures);
      this.listen();
      this.useFrame(0);
      new ResizeObserver(() => this.draw()).observe(this.canvas);
    }

    controls() {
      const select = (label, name, use) => {
        this[name] = element("select", { name });
        this[name].addEventListener("change", () => use(this[name].value));
        return element("label", {}, label, this[name]);
      };
      const bar = element("div", { class: "bar" });
      const last = this.data.frames.length - 1;
      this.frameSlider = element("input", { type: "range", name: "frame", min: "0", max: String(last), step: "1", value: "0" });
      this.frameSlider.addEventListener("input", () => this.useFrame(Number(this.frameSlider.value)));
      this.frameText = element("output", { class: "frame" });
      const frame = element("label", {}, "frame", this.frameSlider, this.frameText);
      frame.hidden = last < 1;
      bar.append(frame, select("A", "aSelect", (v) => this.choose(v)), select("B", "bSelect", (v) => this.choose(this.state.a, v)));
      const modes = element("span", { class: "modes", role: "group", "aria-label": "Mode" });
      this.modeButtons = MODES.map(([mode, name]) => {
        const button = element("button", { type: "button", "data-mode": mode }, name);
        button.addEventListener("click", () => this.set({ mode }));
        return button;
      });
      modes.append(...this.modeButtons);
      this.stops = element("input", { type: "range", min: "-8", max: "8", step: "0.25", value: "0", name: "exposure" });
      this.stops.addEventListener("input", () => this.set({ stops: Number(this.stops.value) }));
      this.stopsText = element("output");
      const range = select("range", "rangeSelect", (v) => this.set({ range: Number(v) }));
      for (const r of [0.02, 0.05, 0.25, 1]) this.rangeSelect.append(element("option", { value: r }, `± ${100 * r} %`));
      this.rangeSelect.value = "0.25";
      this.rangeLabel = range;
      const reset = element("button", { type: "button" }, "Reset");
      reset.addEventListener("click", () => this.reset());
      bar.append(modes, element("label", {}, "exposure", this.stops, this.stopsText), range, reset);
      return bar;
    }

    useFrame(index) {
      this.state.frame = index;
      this.frameText.textContent = this.data.frames[index].frame;
      this.frameSlider.setAttribute("aria-valuetext", `frame ${this.data.frames[index].frame}`);
      const entries = this.data.frames[index].images;
      const before = (select) => select.selectedOptions[0]?.textContent;
      const labels = [before(this.aSelect), before(this.bSelect)];
      for (const select of [this.aSelect, this.bSelect]) {
        select.replaceChildren(...entries.map((e) => element("option", { value: e.id }, e.label)));
      }
      const method = entries.find((e) => e.label === labels[0]) ?? entries.find((e) => e.kind === "method");
      this.choose(method.id, entries.find((e) => e.label === labels[1])?.id);
    }

    entry(id) {
      return this.data.frames[this.state.frame].images.find((e) => e.id === id);
    }

    // Without a B the method's matched reference stands beside it.
    async choose(a, b) {
      const entry = this.entry(a), current = this.entry(this.state.b);
      const keep = current?.kind === "method" ? current.id : undefined;
      this.state.a = a;
      this.state.b = b ?? keep ?? entry.matched ?? entry.full ?? a;
      this.aSelect.value = this.state.a;
      this.bSelect.value = this.state.b;
      try {
        await Promise.all([load(this.state.a), load(this.state.b)]);
        this.showPictures();
        this.set({});
      } catch (error) {
        this.readout.textContent = error.message;
      }
    }

    // What the methods of A and B drew of their own work.
    showPictures() {
      const entries = [...new Set([this.state.a, this.state.b])].map((id) => this.entry(id));
      this.pictures.replaceChildren(...entries.flatMap((entry) => (entry.pictures ?? []).map((picture) => {
        const src = `${ASSETS}/pictures/${encodeURIComponent(picture.file)}`, alt = `${picture.name} of ${entry.label}`;
        const name = element("strong", {}, `${entry.label}: ${picture.name}`);
        return element("figure", {}, element("img", { src, alt, width: entry.width, height: entry.height }), element("figcaption", {}, name, ` ${picture.caption}`));
      })));
    }

    set(changes) {
      Object.assign(this.state, changes);
      const { mode, stops } = this.state;
      for (const button of this.modeButtons) button.setAttribute("aria-pressed", String(button.dataset.mode === mode));
      this.stops.value = stops;
      this.stopsText.textContent = `${stops > 0 ? "+" : ""}${stops} EV`;
      this.rangeLabel.hidden = mode !== "relative";
      this.draw();
    }

    reset() {
      this.set({ stops: 0, zoom: 1, x: 0.5, y: 0.5, split: 0.5, flipped: false });
    }

    listen() {
      const canvas = this.canvas;
      let drag = null;
      canvas.addEventListener("pointerdown", (e) => {
        drag = { x: e.clientX, y: e.clientY };
        canvas.focus({ preventScroll: true });
        canvas.setPointerCapture(e.pointerId);
      });
      canvas.addEventListener("pointerup", () => { drag = null; });
      canvas.addEventListener("pointerenter", () => this.set({ flipped: true }));
      canvas.addEventListener("pointerleave", () => this.set({ flipped: false }));
      canvas.addEventListener("pointermove", (e) => {
        const box = canvas.getBoundingClientRect();
        if (drag && this.state.zoom > 1) {
          const scale = this.scale();
          this.state.x -= ((e.clientX - drag.x) * devicePixelRatio) / scale / this.width;
          this.state.y -= ((e.clientY - drag.y) * devicePixelRatio) / scale / this.height;
          drag = { x: e.clientX, y: e.clientY };
        }
        this.set({ split: (e.clientX - box.left) / box.width, probe: this.pixel(e) ?? this.state.probe });
      });
      canvas.addEventListener("wheel", (e) => {
        if (document.activeElement !== canvas && !e.ctrlKey) return; // an unfocused viewer lets the page scroll
        e.preventDefault();
        this.zoomAbout(this.pixel(e), e.deltaY < 0 ? 1.25 : 0.8);
      }, { passive: false });
      canvas.addEventListener("keydown", (e) => this.press(e));
    }

    press(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const step = event.shiftKey ? 10 : 1, moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      const { stops, flipped } = this.state;
      if (moves[event.key]) this.moveProbe(moves[event.key].map((v) => v * step));
      else if (event.key === "+" || event.key === "=") this.zoomAbout(this.state.probe, 1.25);
      else if (event.key === "-") this.zoomAbout(this.state.probe, 0.8);
      else if (event.key === "[") this.set({ stops: Math.max(stops - 0.25, -8) });
      else if (event.key === "]") this.set({ stops: Math.min(stops + 0.25, 8) });
      else if (event.key === "f" || event.key === "F") this.set({ flipped: !flipped });
      else if (event.key === "0") this.reset();
      else if (MODES[Number(event.key) - 1]) this.set({ mode: MODES[Number(event.key) - 1][0] });
      else return;
      event.preventDefault();
    }

    moveProbe([dx, dy]) {
      const probe = this.state.probe ?? { x: Math.floor(this.width / 2), y: Math.floor(this.height / 2) };
      const clamp = (v, n) => Math.min(Math.max(v, 0), n - 1);
      const moved = { x: clamp(probe.x + dx, this.width), y: clamp(probe.y + dy, this.height) };
      this.set({ probe: moved, split: ((moved.x + 0.5) / this.width - this.state.x) * this.state.zoom + 0.5 });
    }

    // Keeps the given pixel where it is on the screen.
    zoomAbout(pixel, factor) {
      const zoom = Math.min(Math.max(this.state.zoom * factor, 1), 64), ratio = 1 - this.state.zoom / zoom;
      const x = pixel ? (pixel.x + 0.5) / this.width : 0.5, y = pixel ? (pixel.y + 0.5) / this.height : 0.5;
      this.set({ zoom, x: this.state.x + (x - this.state.x) * ratio, y: this.state.y + (y - this.state.y) * ratio });
    }

    get images() { return [loaded.get(this.state.a), loaded.get(this.state.b)]; }
    get width() { return this.entry(this.state.a).width; }
    get height() { return this.entry(this.state.a).height; }
    get panes() { return this.state.mode === "side" ? 2 : 1; }
    scale() { return (this.canvas.width / this.panes / this.width) * this.state.zoom; }

    // Pixel of the image under a pointer event, or null beside the image.
    pixel(event) {
      const box = this.canvas.getBoundingClientRect(), pane = this.canvas.width / this.panes;
      const px = ((event.clientX - box.left) / box.width) * this.canvas.width, py = ((event.clientY - box.top) / box.height) * this.canvas.height;
      const x = Math.floor((px % pane - pane / 2) / this.scale() + this.state.x * this.width);
      const y = Math.floor((py - this.canvas.height / 2) / this.scale() + this.state.y * this.height);
      return x >= 0 && y >= 0 && x < this.width && y < this.height ? { x, y } : null;
    }

    draw() {
      const [a, b] = this.images;
      if (!a || !b) return;
      const { mode, zoom } = this.state;
      const half = 0.5 / zoom, keep = (v) => Math.min(Math.max(v, half), 1 - half);
      this.state.x = keep(this.state.x);
      this.state.y = keep(this.state.y);
      const width = Math.round(this.canvas.clientWidth * devicePixelRatio);
      if (width === 0) return;
      this.canvas.width = width;
      this.canvas.height = Math.round((width / this.panes / a.width) * a.height);
      this.context = this.canvas.getContext("2d");
      this.context.imageSmoothingEnabled = this.scale() < 1;
      const same = a.width === b.width && a.height === b.height, known = a.over[b.id] !== undefined;
      const exposure = this.data.exposure * 2 ** this.state.stops, pane = width / this.panes;
      if (mode === "relative" && same) this.paint(relativeMap(a, b, this.state.range), 0, width);
      else if (mode === "over" && known) this.paint(overMap(a, b), 0, width);
      else if (mode === "side") [a, b].forEach((source, k) => this.paint(toned(source, exposure), k * pane, pane));
      else if (mode === "slider") this.paintSlider(toned(a, exposure), toned(b, exposure), width);
      else if (mode === "flip") this.paint(toned(this.state.flipped ? b : a, exposure), 0, width);
      this.describe(a, b, same, known);
    }

    paint(source, left, width) {
      const c = this.context, scale = this.scale(), w = source.width * scale, h = source.height * scale;
      c.save();
      c.beginPath();
      c.rect(left, 0, width, this.canvas.height);
      c.clip();
      const x = left + width / 2 - this.state.x * w, y = this.canvas.height / 2 - this.state.y * h;
      c.drawImage(source, x, y, w, h);
      if (this.state.probe && this.scale() > 4) {
        c.strokeStyle = "#ffd400";
        c.lineWidth = Math.max(1, devicePixelRatio);
        c.strokeRect(x + this.state.probe.x * scale, y + this.state.probe.y * scale, scale, scale);
      }
      c.restore();
    }

    paintSlider(a, b, width) {
      this.paint(b, 0, width);
      const c = this.context, at = Math.round(this.state.split * width);
      c.save();
      c.beginPath();
      c.rect(0, 0, at, this.canvas.height);
      c.clip();
      this.paint(a, 0, width);
      c.restore();
      c.fillStyle = "#ffffff";
      c.fillRect(at - devicePixelRatio, 0, 2 * devicePixelRatio, this.canvas.height);
    }

    describe(a, b, same, known) {
      const { mode, probe, flipped } = this.state, names = [this.entry(a.id).label, this.entry(b.id).label];
      const swatch = ([name, colour]) => {
        const box = element("b");
        box.style.background = `rgb(${colour.join(" ")})`;
        return element("span", {}, box, name);
      };
      if (mode === "relative") this.key.replaceChildren(...(same ? ["A darker", element("span", { class: "ramp" }), "A brighter than B: (A − B) / (B + 1 % of its mean), luminance"] : ["A and B differ in size"]));
      else if (mode === "over") this.key.replaceChildren(...(known ? STATES.map(swatch) : ["This map exists for a method (A) against its matched or full reference (B)."]));
      else if (mode === "flip") this.key.replaceChildren(`showing ${flipped ? "B" : "A"}: ${names[flipped ? 1 : 0]} (hover or press F to flip)`);
      else this.key.replaceChildren(`left A: ${names[0]}`, element("span", {}, `right B: ${names[1]}`));
      this.readout.replaceChildren(...(probe ? this.values(a, b, same, probe, names) : ["Point at a pixel to read its values; click, then scroll to zoom, drag to pan."]));
    }

    values(a, b, same, probe, names) {
      const lines = [`x ${probe.x}, y ${probe.y}`], wide = Math.max(names[0].length, names[1].length);
      [a, b].forEach((source, k) => {
        const i = probe.y * source.width + probe.x, inside = probe.x < source.width && probe.y < source.height;
        const text = inside ? [0, 1, 2].map((c) => shortest(source.rgb[3 * i + c])).join("  ") : "outside";
        lines.push(`${"AB"[k]} ${names[k].padEnd(wide)}  `, element("span", { "data-pixel": "ab"[k] }, text), k === 0 ? "\n" : "");
      });
      if (same) {
        const error = relativeError(a, b, probe.y * a.width + probe.x);
        lines[0] += `   relative error `;
        lines.splice(1, 0, element("span", { "data-error": "" }, `${(100 * error).toFixed(2)} %`));
      }
      lines.splice(same ? 2 : 1, 0, "\n");
      return lines;
    }
  }

  return { image, open: (place, data) => new Viewer(place, data) };
})();
