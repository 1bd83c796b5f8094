// State of the page, and listeners to its changes.
const TRAJECTORY_MS = 60000;
const SKELETONS_MS = 1000; // maximum age of skeletons
export const store = {
  people: [], cameras: {}, frames: {}, robot: null, joints: {}, predicted: {}, postures: {}, skeletonsMs: 0, predictions: [], trajectories: new Map(), zones: [], zonesBase: 0,
  selected: null, target: null, paused: false, atMs: 0, historyMs: 60000, privacy: false, images: true,
};
const listeners = new Map();

export function on(name, listener) {
  if (!listeners.has(name)) listeners.set(name, []);
  listeners.get(name).push(listener);
}

export function emit(name, value) {
  for (const listener of listeners.get(name) ?? []) listener(value);
}

export function select(id) {
  store.selected = store.selected === id ? null : id;
  emit("selected", store.selected);
}

export function takeScene(scene) {
  store.atMs = scene.at_ms;
  store.cameras = scene.cameras;
  store.robot = scene.robot;
  if (scene.people) {
    store.people = scene.people;
    if (!store.paused) extendTrajectories(scene);
  }
  store.frames[scene.camera] = scene.frame;
  // Keypoints at their depth replace skeletons that are not published, or not yet loaded for a past frame.
  if (store.paused || Math.abs(scene.at_ms - store.skeletonsMs) > SKELETONS_MS) Object.assign(store, { joints: scene.joints, predicted: {}, postures: {} });
  emit("scene", scene);
}

export function takeSkeletons({ at_ms: atMs, camera, frame, joints, predicted, postures }) {
  if (store.paused && frame !== store.frames[camera]) return;
  const ids = store.people.map(({ id }) => id);
  const known = (now, before) => Object.fromEntries(ids.flatMap((id) => (now[id] ?? before[id] ? [[id, now[id] ?? before[id]]] : [])));
  Object.assign(store, { skeletonsMs: atMs, joints: known(joints, store.joints), predicted: known(predicted, store.predicted), postures: known(postures, store.postures) });
  emit("skeletons");
}

export function takeTrajectories(positions) {
  for (const { at_ms: atMs, people } of positions) extendTrajectories({ at_ms: atMs, people: people.map(([id, x, y]) => ({ id, position_m: [x, y] })) });
}

function extendTrajectories({ at_ms: atMs, people }) {
  for (const { id, position_m: [x, y] } of people) {
    if (!store.trajectories.has(id)) store.trajectories.set(id, []);
    store.trajectories.get(id).push([atMs, x, y]);
  }
  for (const [id, trajectory] of store.trajectories) {
    while (trajectory.length && trajectory[0][0] < atMs - TRAJECTORY_MS) trajectory.shift();
    if (!trajectory.length) store.trajectories.delete(id);
  }
}

// Trajectory of a person in the last 20 s before the shown time.
export function trajectoryOf(id) {
  const trajectory = store.trajectories.get(id) ?? [];
  return trajectory.filter(([at]) => at <= store.atMs + 1 && at > store.atMs - 20000);
}
