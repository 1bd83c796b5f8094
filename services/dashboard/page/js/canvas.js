// Canvases at the resolution of the screen.
export function fitCanvas(canvas, height = null) {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const width = canvas.clientWidth, tall = height ?? canvas.clientHeight;
  const [w, h] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(tall * ratio))];
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height: tall };
}

// Draw a label, moved up or down if it would cover another label of the drawing.
export function label(context, text, x, y, ground, ink, taken, size = 12) {
  context.font = `600 ${size}px system-ui, sans-serif`;
  context.textBaseline = "middle";
  const width = context.measureText(text).width + 10, height = size + 7;
  const hides = (bottom) => taken.some((other) => x < other.x + other.width && other.x < x + width && bottom - height < other.y && other.y - other.height < bottom);
  const places = Array.from({ length: 9 }, (_, k) => y + (k % 2 ? -1 : 1) * Math.ceil(k / 2) * (height + 1));
  y = places.find((bottom) => bottom >= height && !hides(bottom)) ?? y;
  taken.push({ x, y, width, height });
  context.fillStyle = ground;
  context.beginPath();
  context.roundRect(x, y - height, width, height, 4);
  context.fill();
  context.fillStyle = ink;
  context.fillText(text, x + 5, y - height / 2 + 0.5);
  return width;
}

export function arrow(context, x0, y0, x1, y1, colour, width) {
  const length = Math.hypot(x1 - x0, y1 - y0);
  if (length < 2) return;
  const [dx, dy] = [(x1 - x0) / length, (y1 - y0) / length];
  const head = Math.min(9, length * 0.6);
  for (const [stroke, extra] of [["rgb(255 255 255 / 85%)", 3], [colour, 0]]) {
    context.strokeStyle = stroke;
    context.lineWidth = width + extra;
    context.lineCap = context.lineJoin = "round";
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
    context.moveTo(x1 - head * (dx + 0.6 * dy), y1 - head * (dy - 0.6 * dx));
    context.lineTo(x1, y1);
    context.lineTo(x1 - head * (dx - 0.6 * dy), y1 - head * (dy + 0.6 * dx));
    context.stroke();
  }
}
