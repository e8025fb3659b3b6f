const showNoPicture = (reason) => {
  if (document.getElementById("no-webgl") || document.body.dataset.ready) return;
  const box = document.createElement("div");
  box.id = "no-webgl";
  box.setAttribute("role", "alert");
  box.style.cssText = "position:absolute;left:0;right:0;top:20%;margin:auto;max-width:32em;" +
    "padding:16px 20px;font:15px/1.5 system-ui,sans-serif;color:#222;background:#fff;" +
    "border:1px solid #ccc;border-radius:4px;z-index:99";
  box.textContent = "This page can't be drawn: " + reason + " Enable hardware acceleration (or " +
    "WebGL) in the settings of this browser, or use another browser. Pictures without a " +
    'browser: view.save("view.png"), or .gif for an animation.';
  document.body.appendChild(box);
  document.body.dataset.failed = "yes";
};
const probe = document.createElement("canvas");
if (!(window.WebGL2RenderingContext && probe.getContext("webgl2")))
  showNoPicture("this browser has no WebGL 2, which three-dimensional views need.");
window.addEventListener("unhandledrejection", (event) =>
  showNoPicture("an error occurred (" + (event.reason && event.reason.message || event.reason) + ")."));
