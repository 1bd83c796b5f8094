// 3D: skeletons, cameras and the depth cloud, by three.js.
import * as three from "../vendor/three.module.min.js";
import { colourOf, css } from "./colours.js";
import { on, store } from "./store.js";

const LIMBS = [[5, 6], [5, 7], [7, 9], [6, 8], [8, 10], [5, 11], [6, 12], [11, 12], [11, 13], [13, 15], [12, 14], [14, 16], [0, 5], [0, 6]];
const START = { azimuth: 2.6, height: 0.5, distance: 7, target: [2.5, 0, 0.8] };

const PREDICTED_OPACITY = 0.35;
const CLOUD_MS = 1000; // maximum age of a cloud with newer people

export function openSpace(canvas) {
  const note = document.getElementById("space-note");
  const renderer = new three.WebGLRenderer({ canvas, antialias: true, powerPreference: "low-power" });
  const scene = new three.Scene(), camera = new three.PerspectiveCamera(50, 1, 0.05, 200);
  camera.up.set(0, 0, 1);
  const grid = new three.GridHelper(20, 20);
  grid.rotation.x = Math.PI / 2;
  const people = new three.Group(), cameras = new three.Group(), cloud = new three.Points(new three.BufferGeometry(), new three.PointsMaterial({ size: 0.022, vertexColors: true }));
  cloud.frustumCulled = false;
  scene.add(grid, people, cameras, cloud);
  const view = structuredClone(START);

  // Slow rendering (no graphics card) reduces the resolution, in favour of the rest of the page.
  let waiting = false, tookMs = 0;
  function draw() {
    if (waiting) return;
    waiting = true;
    setTimeout(() => requestAnimationFrame(render), Math.min(4000, 4 * Math.max(0, tookMs - 12)));
  }

  function render() {
    waiting = false;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || document.hidden) return;
    renderer.setPixelRatio(tookMs > 60 ? 0.5 : Math.min(devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    const [x, y, z] = view.target, flat = Math.cos(view.height) * view.distance;
    camera.position.set(x + Math.cos(view.azimuth) * flat, y + Math.sin(view.azimuth) * flat, z + Math.sin(view.height) * view.distance);
    camera.lookAt(x, y, z);
    const begin = performance.now();
    if (changed) build();
    renderer.render(scene, camera);
    renderer.getContext().finish();
    tookMs = 0.5 * tookMs + 0.5 * (performance.now() - begin);
  }

  function clear(group) {
    for (const child of group.children) { child.geometry.dispose(); child.material.dispose(); }
    group.clear();
  }

  function lines(points, colour, opacity = 1) {
    const geometry = new three.BufferGeometry().setFromPoints(points.map((p) => new three.Vector3(...p)));
    return new three.LineSegments(geometry, new three.LineBasicMaterial({ color: colour, transparent: opacity < 1, opacity }));
  }

  function bone(a, b, colour, radius, opacity = 1) {
    const [p, q] = [new three.Vector3(...a), new three.Vector3(...b)];
    const geometry = new three.CylinderGeometry(radius, radius, p.distanceTo(q), 6);
    const mesh = new three.Mesh(geometry, new three.MeshBasicMaterial({ color: colour, transparent: opacity < 1, opacity }));
    mesh.position.copy(p).lerp(q, 0.5);
    mesh.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), q.sub(p).normalize());
    return mesh;
  }

  function addPerson(person) {
    const colour = colourOf(person.id), joints = store.joints[person.id], radius = person.id === store.selected ? 0.045 : 0.024;
    const [x, y, z] = person.position_m, hidden = new Set(store.predicted[person.id]);
    if (joints) {
      for (const [a, b] of LIMBS) {
        const opacity = hidden.has(a) || hidden.has(b) ? PREDICTED_OPACITY : 1;
        if (joints[a] && joints[b]) people.add(bone(joints[a], joints[b], colour, radius, opacity));
      }
      if (joints[0]) {
        const head = new three.Mesh(new three.SphereGeometry(0.09, 12, 8), new three.MeshBasicMaterial({ color: colour, transparent: hidden.has(0), opacity: hidden.has(0) ? PREDICTED_OPACITY : 1 }));
        head.position.set(...joints[0]);
        people.add(head);
      }
    } else people.add(bone([x, y, 0.02], [x, y, Math.max(0.4, z + 0.4)], colour, radius));
    const ring = Array.from({ length: 24 }, (_, k) => [k, k + 1]).flat().map((k) => [x + 0.3 * Math.cos(k * Math.PI / 12), y + 0.3 * Math.sin(k * Math.PI / 12), 0.01]);
    people.add(lines(ring, colour));
    if (person.yaw_rad !== null) people.add(lines([[x, y, 0.02], [x + 0.6 * Math.cos(person.yaw_rad), y + 0.6 * Math.sin(person.yaw_rad), 0.02]], colour));
  }

  function addCamera({ pose, field_m: field }) {
    if (!pose) return;
    const at = ([a, b, c]) => [0, 1, 2].map((k) => pose[4 * k] * a + pose[4 * k + 1] * b + pose[4 * k + 2] * c + pose[4 * k + 3]);
    const corners = [[-0.5, -0.38, 0.8], [0.5, -0.38, 0.8], [0.5, 0.38, 0.8], [-0.5, 0.38, 0.8]].map((p) => at(p.map((v) => v * 0.5)));
    const eye = at([0, 0, 0]);
    cameras.add(lines(corners.flatMap((p, k) => [eye, p, p, corners[(k + 1) % 4]]), css("quiet")));
    if (field) cameras.add(lines([[...field[0], 0], [...field[1], 0], [...field[0], 0], [...field[2], 0]], css("quiet"), 0.4));
  }

  let changed = true, cloudShown = true, cloudFrame = "", cloudCamera = "", cloudMs = 0;
  function takeScene() { changed = true; setCloud(); draw(); }

  // A live cloud arrives less often than people. A past cloud is shown with its own frame only.
  function setCloud() {
    const same = cloudFrame === store.frames[cloudCamera];
    cloud.visible = cloudShown && (same || (!store.paused && Math.abs(store.atMs - cloudMs) < CLOUD_MS));
    canvas.dataset.cloud = cloud.visible ? cloudFrame : "";
  }

  function build() {
    changed = false;
    clear(people);
    clear(cameras);
    store.people.forEach(addPerson);
    Object.values(store.cameras).forEach(addCamera);
    note.hidden = !store.people.some(({ id }) => store.predicted[id]?.length);
  }

  function takeCloud(packet) {
    const { width, height, fx, fy, cx, cy, pose, rgb } = packet;
    [cloudFrame, cloudCamera, cloudMs] = [packet.frame, packet.camera, packet.at_ms];
    const depth = new DataView(packet.depth_mm.buffer, packet.depth_mm.byteOffset, packet.depth_mm.byteLength);
    const points = [], colours = [];
    for (let k = 0; k < width * height; k++) {
      const z = depth.getUint16(2 * k, true) / 1000;
      if (!z) continue;
      const x = ((k % width) - cx) / fx * z, y = (Math.floor(k / width) - cy) / fy * z;
      for (let r = 0; r < 3; r++) points.push(pose[4 * r] * x + pose[4 * r + 1] * y + pose[4 * r + 2] * z + pose[4 * r + 3]);
      for (let c = 0; c < 3; c++) colours.push((rgb[3 * k + c] / 255) ** 2.2);
    }
    cloud.geometry.dispose();
    cloud.geometry = new three.BufferGeometry();
    cloud.geometry.setAttribute("position", new three.Float32BufferAttribute(points, 3));
    cloud.geometry.setAttribute("color", new three.Float32BufferAttribute(colours, 3));
    setCloud();
    draw();
  }

  function theme() {
    scene.background = new three.Color(css("stage"));
    grid.material.dispose();
    scene.remove(grid);
    grid.material = new three.LineBasicMaterial({ color: css("line") });
    scene.add(grid);
    takeScene();
  }

  let drag = null;
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); drag = [event.offsetX, event.offsetY]; });
  canvas.addEventListener("pointermove", (event) => {
    if (!drag) return;
    turn(event.offsetX - drag[0], event.offsetY - drag[1]);
    drag = [event.offsetX, event.offsetY];
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { drag = null; });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(event.deltaY / 600)); }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-24, 0], ArrowRight: [24, 0], ArrowUp: [0, -24], ArrowDown: [0, 24] }[event.key];
    if (step) turn(...step);
    else if (event.key === "+" || event.key === "=") zoom(0.85);
    else if (event.key === "-") zoom(1.18);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  function turn(du, dv) {
    view.azimuth -= du / 150;
    view.height = Math.min(1.55, Math.max(-0.2, view.height + dv / 150));
    draw();
  }
  function zoom(factor) { view.distance = Math.min(60, Math.max(0.5, view.distance * factor)); draw(); }

  for (const name of ["scene", "skeletons"]) on(name, takeScene);
  on("selected", takeScene);
  on("message:cloud", takeCloud);
  on("theme", theme);
  addEventListener("resize", draw);
  theme();
  return {
    reset() { Object.assign(view, structuredClone(START)); draw(); },
    showCloud(shown) { cloudShown = shown; setCloud(); draw(); },
  };
}
