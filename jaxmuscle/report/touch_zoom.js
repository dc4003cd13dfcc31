/* Fingers on a chart: two zoom time, one moves it, two taps show all. Up and down still scrolls the page,
   which the chart's style "touch-action: pan-y" leaves to the browser. */
"use strict";
/* element: the area of the chart; range: () => [low, high] that it shows; show(low, high), reset(). */
function touchZoom(element, range, show, reset) {
  const STILL = 8, AGAIN = 350, NEAR = 40;  /* px a finger trembles; ms and px between two taps */
  const fingers = new Map();                /* pointer → its place in the chart [px] */
  let begun = null, moved = false, tap = { time: -Infinity, x: 0 };

  const place = event => {
    const box = element.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top, width: box.width };
  };
  /* Middle of the fingers, and how far they are apart; one finger always 1. */
  function grip() {
    const [a, b = a] = [...fingers.values()];
    return { x: (a.x + b.x) / 2, apart: Math.max(Math.hypot(a.x - b.x, a.y - b.y), 1), width: a.width };
  }
  /* Whenever a finger comes or goes the motion begins anew, from what is shown now. */
  function begin() {
    if (!fingers.size) { begun = null; return; }
    const held = grip(), [low, high] = range();
    begun = { ...held, span: high - low, under: low + (high - low) * held.x / held.width };
  }

  element.addEventListener("pointerdown", event => {
    if (event.pointerType !== "touch") return;
    moved = fingers.size > 0;
    fingers.set(event.pointerId, place(event));
    begin();
  });
  element.addEventListener("pointermove", event => {
    if (!fingers.has(event.pointerId)) return;
    fingers.set(event.pointerId, place(event));
    const now = grip();
    if (!moved && Math.abs(now.x - begun.x) < STILL) return;
    moved = true;
    /* What was between the fingers stays between them. */
    const span = begun.span * begun.apart / now.apart, low = begun.under - span * now.x / now.width;
    show(low, low + span);
  });
  function lift(event) {
    const last = fingers.get(event.pointerId);
    if (!fingers.delete(event.pointerId)) return;
    begin();
    if (moved || event.type !== "pointerup") return;
    const twice = event.timeStamp - tap.time < AGAIN && Math.abs(last.x - tap.x) < NEAR;
    tap = { time: twice ? -Infinity : event.timeStamp, x: last.x };
    if (twice) reset();
  }
  element.addEventListener("pointerup", lift);
  /* The browser has taken the finger, to scroll. */
  element.addEventListener("pointercancel", lift);
  /* Two fingers are ours, also where they move up and down. */
  element.addEventListener("touchstart", event => {
    if (event.touches.length > 1 && event.cancelable) event.preventDefault();
  }, { passive: false });
}
