const content = CONTENT;
const element = (kind, style, text, parent) => {
  const made = document.createElement(kind);
  made.style.cssText = style;
  if (text) made.textContent = text;
  (parent || document.body).appendChild(made);
  return made;
};
document.title = content.title;
const font = "font:13px/1.45 system-ui,sans-serif;color:#222;";
const canvas = document.getElementById("canvasTarget");
const box = element("div", font + "position:absolute;left:8px;top:8px;max-width:230px;" +
  "max-height:calc(100% - 90px);overflow:auto;padding:8px 10px;background:#fff;" +
  "border:1px solid #ccc;border-radius:4px;z-index:9");
box.id = "legend";
element("div", "font-weight:600;margin-bottom:3px", content.title, box);
for (const [colour, name] of content.entries) {
  const line = element("div", "display:flex;align-items:center;gap:7px", "", box);
  element("span", "flex:none;width:13px;height:13px;border:1px solid #777;background:" + colour,
    "", line);
  element("span", "", name, line);
}
for (const note of content.notes) element("div", "color:#555;font-size:12px", note, box);
if (content.times && content.times.length > 1) {
  const times = content.times, last = times.length - 1, whole = times[last] - times[0];
  const [unit, factor] = whole < 1e-3 ? ["µs", 1e6] : whole < 1 ? ["ms", 1e3] : ["s", 1];
  const digits = Math.max(0, 3 - Math.floor(Math.log10(whole * factor)));
  const bar = element("div", font + "position:absolute;left:0;right:0;bottom:0;display:flex;" +
    "gap:10px;align-items:center;padding:7px 12px;background:rgba(255,255,255,.92);" +
    "border-top:1px solid #ccc;z-index:9");
  const button = element("button", font + "width:62px;padding:3px 0", "Play", bar);
  button.id = "play";
  const slider = element("input", "flex:1;min-width:60px", "", bar);
  Object.assign(slider, { id: "time", type: "range", min: 0, max: last, step: 1, value: 0 });
  slider.setAttribute("aria-label", "time");
  const clock = element("span", "min-width:105px;text-align:right;white-space:nowrap;" +
    "font-variant-numeric:tabular-nums", "", bar);
  clock.id = "clock";
  const speed = element("select", font + "padding:2px", "", bar);
  speed.id = "speed";
  speed.setAttribute("aria-label", "speed");
  const usual = whole / content.duration;
  const says = (rate) => rate >= 1 ? +rate.toPrecision(2) + " × as fast" :
    +(1 / rate).toPrecision(2) + " × slower";
  for (const times_usual of [0.1, 0.25, 0.5, 1, 2, 4]) {
    const choice = element("option", "", says(usual * times_usual), speed);
    choice.value = usual * times_usual;
    choice.selected = times_usual === 1;
  }
  if (whole > 0.2) {
    const real = element("option", "", "real time", speed);
    real.value = 1;
  }
  let busy = false, wanted = 0, playing = false, at = times[0], before = 0;
  const show = async (frame) => {
    wanted = frame;
    slider.value = frame;
    clock.textContent = "t = " + (times[frame] * factor).toFixed(digits) + " " + unit;
    if (busy) return;
    busy = true;
    let shown = -1;
    while (shown !== wanted) {
      shown = wanted;
      await K3DInstance.setTime(shown);
    }
    busy = false;
    document.body.dataset.frame = shown;
  };
  const frameAt = (time) => {
    let low = 0, high = last;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= time) low = middle; else high = middle - 1;
    }
    return low;
  };
  const tick = (now) => {
    if (!playing) return;
    at += (now - before) / 1000 * parseFloat(speed.value);
    before = now;
    if (at >= times[last]) at = times[0];
    const frame = frameAt(at);
    if (frame !== wanted) show(frame);
    requestAnimationFrame(tick);
  };
  const play = (on) => {
    playing = on;
    button.textContent = on ? "Pause" : "Play";
    before = performance.now();
    if (on) requestAnimationFrame(tick);
  };
  button.onclick = () => play(!playing);
  slider.oninput = () => { play(false); at = times[+slider.value]; show(+slider.value); };
  const asked = /^#t=(.+)$/.exec(decodeURIComponent(location.hash));
  if (asked && isFinite(+asked[1])) at = +asked[1];
  show(frameAt(at));
}
const fit = () => {
  const beside = window.innerWidth > 640 ? box.offsetWidth + 16 : 0;
  Object.assign(canvas.style, { left: beside + "px", width: `calc(100% - ${beside}px)`,
    height: content.times ? "calc(100% - 43px)" : "100%" });
  K3DInstance.resizeHelper();
};
window.addEventListener("resize", fit);
fit();
document.documentElement.style.background = document.body.style.background = "#fff";
document.body.dataset.ready = "yes";
