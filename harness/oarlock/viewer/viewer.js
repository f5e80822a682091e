"use strict";
(() => {
  const shown = JSON.parse(document.getElementById("document").textContent);
  const at = id => document.getElementById(id);
  const ROWS = 200, MARGIN = 1.3;

  function unpack(array) {
    const bytes = Uint8Array.from(atob(array.data), c => c.charCodeAt(0));
    const data = array.kind === "<u4" ? new Uint32Array(bytes.buffer) : new Float32Array(bytes.buffer);
    const width = array.shape.slice(1).reduce((a, b) => a * b, 1);
    return { data, shape: array.shape, row: n => data.subarray(n * width, (n + 1) * width) };
  }
  function figure(value, unit) {
    if (!Number.isFinite(value)) return "–";
    const size = Math.abs(value);
    const text = size === 0 ? "0" : size >= 0.01 && size < 1000 ? value.toPrecision(3) : value.toExponential(2);
    return unit ? `${text} ${unit}` : text;
  }
  const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  const times = unpack(shown.times).data, count = times.length;
  const sides = shown.sides.map(side => {
    const arrays = Object.fromEntries(["poses", "middles", "gaps", "forces", "off", "pulls", "drift", "tendons"].map(
      name => [name, unpack(side[name])]));
    return { title: side.title, frames: side.frames, ...arrays };
  });

  // The scene.

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true });
  } catch (error) {
    at("body").textContent = "This browser has no WebGL, so that nothing can be drawn; the figures are beside.";
  }
  const scene = new THREE.Scene(), extent = shown.extent;
  const camera = new THREE.PerspectiveCamera(30, 1, extent / 50, extent * 60);
  camera.up.set(0, 0, 1);
  scene.add(new THREE.AmbientLight(0xffffff, 1.5), camera);
  const light = new THREE.DirectionalLight(0xffffff, 2.2);
  light.position.set(0.5, 0.9, 1);
  camera.add(light);

  const upright = geometry => geometry.rotateX(Math.PI / 2);
  const meshes = shown.scene.meshes.map(mesh => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(unpack(mesh.vertices).data, 3));
    geometry.setIndex(new THREE.BufferAttribute(unpack(mesh.faces).data, 1));
    const flat = geometry.toNonIndexed();
    flat.computeVertexNormals();
    return flat;
  });
  const geometries = shown.scene.shapes.map(shape => {
    const [a, b, c, d] = shape.size;
    switch (shape.kind) {
      case "sphere": return new THREE.SphereGeometry(a, 32, 20);
      case "ellipsoid": return new THREE.SphereGeometry(1, 32, 20).scale(a, b, c);
      case "capsule": return upright(new THREE.CapsuleGeometry(a, 2 * b, 10, 24));
      case "cylinder": return upright(new THREE.CylinderGeometry(a, a, 2 * b, 32));
      case "box": return new THREE.BoxGeometry(2 * a, 2 * b, 2 * c);
      case "mesh": return meshes[shape.mesh];
      case "stick": return rod(d, new THREE.Vector3(...shape.pos), new THREE.Vector3(a, b, c));
      default: return null;
    }
  });
  function rod(radius, from, to) {
    const along = to.clone().sub(from);
    const geometry = upright(new THREE.CapsuleGeometry(radius, along.length(), 6, 14));
    const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), along.normalize());
    return geometry.applyQuaternion(turn).translate(...from.add(to).multiplyScalar(0.5).toArray());
  }

  const grids = [], ghosts = [], marks = [];
  const pose = (group, values, n) => {
    group.position.set(values[n], values[n + 1], values[n + 2]);
    group.quaternion.set(values[n + 4], values[n + 5], values[n + 6], values[n + 3]);
  };
  function plane(shape, group, data, n) {
    const frame = new THREE.Group(), own = new THREE.Group();
    pose(group, data, n);
    group.updateMatrixWorld(true);
    own.position.set(...shape.pos);
    own.quaternion.set(shape.quat[1], shape.quat[2], shape.quat[3], shape.quat[0]);
    group.add(own);
    own.updateMatrixWorld(true);
    const middle = own.worldToLocal(new THREE.Vector3(...shown.centre));
    const [x, y] = [shape.size[0] || 1.2 * extent, shape.size[1] || 1.2 * extent].map(size => Math.min(size, 1.2 * extent));
    frame.position.set(shape.size[0] ? Math.max(x - shape.size[0], Math.min(shape.size[0] - x, middle.x)) : middle.x,
      shape.size[1] ? Math.max(y - shape.size[1], Math.min(shape.size[1] - y, middle.y)) : middle.y, 0);
    const points = [], parts = 16;
    for (let i = 0; i <= parts; i++) {
      const s = 2 * i / parts - 1;
      points.push(-x, s * y, 0, x, s * y, 0, s * x, -y, 0, s * x, y, 0);
    }
    const lines = new THREE.BufferGeometry();
    lines.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    const material = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.6 });
    grids.push(material);
    frame.add(new THREE.LineSegments(lines, material));
    own.add(frame);
  }

  const ghost = new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.42, depthWrite: false, polygonOffset: true,
    polygonOffsetFactor: 1, polygonOffsetUnits: 40 });
  const materials = new Map();
  function paint(rgba) {
    const key = rgba.join();
    if (!materials.has(key)) {
      const clear = rgba[3] < 0.99;
      materials.set(key, new THREE.MeshLambertMaterial({ color: new THREE.Color().setRGB(rgba[0], rgba[1], rgba[2], THREE.SRGBColorSpace),
        transparent: clear, opacity: rgba[3], side: THREE.DoubleSide }));
    }
    return materials.get(key);
  }
  const standing = unpack(shown.standing).data, clickable = [];
  function figureOf(material, bodies, data) {
    const whole = new THREE.Group();
    const groups = bodies.map((body, place) => {
      const group = new THREE.Group();
      whole.add(group);
      shown.scene.shapes.forEach((shape, number) => {
        if (shape.body !== body) return;
        if (shape.kind === "plane") {
          if (!material) plane(shape, group, data, 7 * place);
          return;
        }
        const mesh = new THREE.Mesh(geometries[number], material || paint(shape.rgba));
        if (shape.kind !== "stick") {
          mesh.position.set(...shape.pos);
          mesh.quaternion.set(shape.quat[1], shape.quat[2], shape.quat[3], shape.quat[0]);
        }
        mesh.userData.body = body;
        if (material) mesh.renderOrder = 2;
        clickable.push(mesh);
        group.add(mesh);
      });
      pose(group, data, 7 * place);
      return group;
    });
    scene.add(whole);
    return { whole, groups };
  }
  const still = figureOf(null, shown.still, standing);
  sides.forEach((side, number) => {
    Object.assign(side, figureOf(number ? ghost : null, shown.moving, side.poses.row(0)));
    const [, tendons, points] = side.tendons.shape;
    side.ways = [];
    for (let n = 0; n < tendons; n++) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * Math.max(1, points - 1)), 3));
      const lines = new THREE.LineSegments(geometry, number ? ghosts[0] ||= new THREE.LineBasicMaterial() : marks[0] ||= new THREE.LineBasicMaterial());
      lines.frustumCulled = false;
      side.whole.add(lines);
      side.ways.push(lines);
    }
  });

  // Gaps and forces.

  const overlay = { depthTest: false, depthWrite: false, transparent: true };
  const red = new THREE.MeshBasicMaterial(overlay);
  const orange = [new THREE.MeshBasicMaterial({ ...overlay, opacity: 0.9 }), new THREE.MeshBasicMaterial({ ...overlay, opacity: 0.9 })];
  const unit = upright(new THREE.CylinderGeometry(1, 1, 1, 12)), ball = new THREE.SphereGeometry(1, 16, 12);
  const tip = upright(new THREE.ConeGeometry(1, 1, 16)).translate(0, 0, -0.5);
  const north = new THREE.Vector3(0, 0, 1), way = new THREE.Vector3(), from = new THREE.Vector3(), to = new THREE.Vector3();
  const joined = sides[0].gaps.shape[1];
  const thin = extent * 0.0035 * Math.max(0.4, Math.min(1, 12 / Math.max(1, joined)));
  const over = (geometry, material, order) => {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.renderOrder = order;
    mesh.frustumCulled = false;
    scene.add(mesh);
    return mesh;
  };
  const gaps = Array.from({ length: joined }, () => ({ rod: over(unit, red, 12), ends: [over(ball, red, 12), over(ball, red, 12)] }));
  const arrows = sides.map((_, number) => Array.from({ length: joined }, () => (
    { shaft: over(unit, orange[number], 10 - number), tip: over(tip, orange[number], 10 - number) })));
  function stretch(mesh, a, b, radius) {
    way.copy(b).sub(a);
    const length = way.length();
    mesh.visible = length > 0;
    mesh.position.copy(a).addScaledVector(way, 0.5);
    if (length > 0) mesh.quaternion.setFromUnitVectors(north, way.divideScalar(length));
    mesh.scale.set(radius, radius, length);
  }
  const finite = (values, n) => Number.isFinite(values[n] + values[n + 1] + values[n + 2]);

  let now = -1, factor = shown.factor, arrow = shown.newton;
  function place() {
    const [gapsOn, forcesOn] = [at("show-gaps").checked, at("show-forces").checked];
    sides.forEach((side, number) => {
      const there = now < side.frames, frame = Math.min(now, side.frames - 1);
      side.whole.visible = there && at(number ? "show-exact" : "show-own").checked;
      const poses = side.poses.row(frame);
      side.groups.forEach((group, n) => pose(group, poses, 7 * n));
      const points = side.tendons.shape[2], ways = side.tendons.row(frame);
      side.ways.forEach((lines, n) => {
        const position = lines.geometry.attributes.position;
        for (let k = 0; k + 1 < points; k++) position.array.set(ways.subarray(3 * (n * points + k), 3 * (n * points + k + 2)), 6 * k);
        position.needsUpdate = true;
      });
      const middles = side.middles.row(frame), apart = side.gaps.row(frame), forces = side.forces.row(frame);
      for (let n = 0; n < joined; n++) {
        const open = number ? 0 : 0.5 * factor;
        from.set(middles[3 * n], middles[3 * n + 1], middles[3 * n + 2]);
        to.copy(from);
        if (finite(apart, 3 * n)) {
          way.set(apart[3 * n], apart[3 * n + 1], apart[3 * n + 2]).multiplyScalar(open);
          to.add(way);
          from.sub(way);
        }
        if (!number) {
          const { rod: bar, ends } = gaps[n], seen = gapsOn && there && finite(apart, 3 * n);
          stretch(bar, from, to, thin);
          bar.visible &&= seen;
          ends[0].position.copy(from);
          ends[1].position.copy(to);
          for (const end of ends) { end.visible = seen; end.scale.setScalar(1.9 * thin); }
        }
        const { shaft, tip: head } = arrows[number][n], start = to.clone();
        const seen = forcesOn && there && finite(forces, 3 * n) && at(number ? "show-exact" : "show-own").checked;
        way.set(forces[3 * n], forces[3 * n + 1], forces[3 * n + 2]).multiplyScalar(arrow);
        const length = seen ? way.length() : 0;
        head.visible = shaft.visible = length > 1e-3 * extent;
        if (!head.visible) continue;
        const point = Math.min(0.5 * length, 9 * thin), end = start.clone().add(way);
        way.divideScalar(length);
        head.position.copy(end);
        head.quaternion.setFromUnitVectors(north, way);
        head.scale.set(0.38 * point, 0.38 * point, point);
        stretch(shaft, start, end.addScaledVector(way, -0.9 * point), number ? 0.8 * thin : 1.15 * thin);
      }
    });
  }

  // Figures.

  const rows = [], figures = [];
  const cell = (parent, tag, text) => {
    const node = document.createElement(tag);
    node.textContent = text;
    parent.append(node);
    return node;
  };
  shown.equalities.slice(0, ROWS).forEach((equality, number) => {
    const row = cell(at("rows"), "tr", "");
    cell(row, "td", equality.name);
    rows.push({ equality, number, cells: [...sides.slice(0, 1), ...sides].map(() => cell(row, "td", "")) });
  });
  if (shown.equalities.length > ROWS) at("more").textContent = `and ${shown.equalities.length - ROWS} more, which are drawn`;
  for (const [title, value] of [
    ["drift of MuJoCo", n => figure(sides[0].drift.data[n], shown.unit)],
    ...(sides[1] ? [["drift of the exact motion", n => n < sides[1].frames ? figure(sides[1].drift.data[n], shown.unit) : "–"]] : []),
    ...(joined ? [["largest force, MuJoCo", n => figure(strongest(sides[0], n), "N")]] : []),
    ...(joined && sides[1] ? [["largest force, exact", n => n < sides[1].frames ? figure(strongest(sides[1], n), "N") : "–"]] : []),
  ]) {
    cell(at("figures"), "dt", title);
    figures.push([cell(at("figures"), "dd", ""), value]);
  }
  const size = (values, n) => Math.hypot(values[3 * n], values[3 * n + 1], values[3 * n + 2]);
  function strongest(side, frame) {
    const forces = side.forces.row(frame);
    let most = 0;
    for (let n = 0; n < joined; n++) if (size(forces, n) > most) most = size(forces, n);
    return most;
  }
  function tell() {
    at("clock").textContent = `t = ${times[now].toFixed(3)} s`;
    for (const [node, value] of figures) node.textContent = value(now);
    for (const { equality, number, cells } of rows) {
      cells[0].textContent = figure(sides[0].off.row(now)[number], equality.unit);
      sides.forEach((side, k) => {
        cells[k + 1].textContent = now < side.frames ? figure(side.pulls.row(now)[number], equality.effort) : "–";
      });
    }
  }
  const most = shown.drift || 1;
  at("curve").setAttribute("points", Array.from(sides[0].drift.data, (value, n) =>
    `${(1000 * n / Math.max(1, count - 1)).toFixed(1)},${(32 - 30 * Math.min(1, (value || 0) / most)).toFixed(1)}`).join(" "));

  // The view.

  const controls = renderer && new THREE.OrbitControls(camera, renderer.domElement);
  if (controls) Object.assign(controls, { minDistance: extent / 15, maxDistance: 25 * extent });
  function look() {
    const box = at("stage"), aspect = box.clientWidth / Math.max(1, box.clientHeight);
    const half = Math.tan(camera.fov * Math.PI / 360), [width, height, depth] = shown.frame;
    const away = 0.5 * MARGIN * Math.max(height / half, width / (half * aspect)) + 0.5 * depth;
    camera.position.set(...shown.towards).multiplyScalar(away).add(new THREE.Vector3(...shown.centre));
    controls.target.set(...shown.centre);
    controls.update();
  }
  let dirty = true;
  function fit() {
    const { clientWidth: width, clientHeight: height } = at("stage");
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    renderer.setSize(width, Math.max(1, height), false);
    camera.aspect = width / Math.max(1, height);
    camera.updateProjectionMatrix();
    dirty = true;
  }
  function dress() {
    scene.background = new THREE.Color(colour("--paper"));
    ghost.color.set(colour("--ghost"));
    red.color.set(colour("--gap"));
    orange[0].color.set(colour("--force"));
    orange[1].color.set(colour("--exactforce"));
    for (const grid of grids) grid.color.set(colour("--grid"));
    marks[0]?.color.set(colour("--ink"));
    ghosts[0]?.color.set(colour("--ghost"));
    dirty = true;
  }
  function draw() {
    renderer.render(scene, camera);
    dirty = false;
    document.documentElement.dataset.drawn = String(now);
  }

  // Time.

  let playing = false, recording = null, clock = 0, before = 0, told = 0;
  function go(frame) {
    now = Math.max(0, Math.min(count - 1, frame));
    at("time").value = now;
    if (renderer) place();
    dirty = true;
  }
  function play(on) {
    playing = on;
    before = performance.now();
    clock = now >= count - 1 && on ? times[0] : times[now];
    at("play").textContent = on ? "Pause" : "Play";
    tell();
  }
  function tick(moment) {
    requestAnimationFrame(tick);
    if (playing) {
      clock += Math.max(0, moment - before) / 1000 * Number(at("speed").value);
      before = moment;
      if (clock > times[count - 1]) {
        clock = times[0];
        if (recording) {
          recording.stop();
          recording = null;
          play(false);
        }
      }
      let frame = Math.min(now, count - 1);
      if (times[frame] > clock) frame = 0;
      while (frame + 1 < count && times[frame + 1] <= clock) frame++;
      if (frame !== now) go(frame);
    }
    if (dirty && moment - told > 80) { told = moment; tell(); }
    if (dirty && renderer) draw();
  }
  // A film of what is seen, once through, as the browser records it.
  function record() {
    const film = new MediaRecorder(renderer.domElement.captureStream(30)), parts = [];
    film.ondataavailable = event => parts.push(event.data);
    film.onstop = () => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob(parts, { type: film.mimeType }));
      link.download = `${document.querySelector("#said b").textContent.replace(/[^\w-]+/g, "-")}.${film.mimeType.includes("mp4") ? "mp4" : "webm"}`;
      link.click();
      document.documentElement.dataset.recorded = String(parts.reduce((sum, part) => sum + part.size, 0));
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    };
    play(false);
    go(0);
    film.start();
    recording = film;
    play(true);
  }
  at("time").max = count - 1;
  at("time").addEventListener("input", () => { play(false); go(Number(at("time").value)); tell(); });
  at("play").addEventListener("click", () => play(!playing));
  at("worst").addEventListener("click", () => {
    let worst = 0;
    sides[0].drift.data.forEach((value, n) => { if (value > sides[0].drift.data[worst]) worst = n; });
    play(false);
    go(worst);
    tell();
  });
  addEventListener("keydown", event => {
    if (event.target.matches("input, select, button")) return;
    if (event.key === " ") { event.preventDefault(); play(!playing); }
    else if (event.key === "ArrowRight" || event.key === "ArrowLeft") { play(false); go(now + (event.key === "ArrowRight" ? 1 : -1)); tell(); }
  });
  function scaled() {
    factor = Math.max(1, Number((10 ** Number(at("factor").value)).toPrecision(2)));
    arrow = shown.newton * 10 ** Number(at("arrow").value);
    const round = Number((10 ** Math.floor(Math.log10(0.25 * extent / arrow))).toPrecision(1));
    at("factor-said").textContent = `× ${factor.toLocaleString("en").replaceAll(",", "\u202f")}`;
    at("arrow-said").textContent = `${round} N: ${figure(round * arrow, "m")}`;
    go(now);
  }
  for (const node of document.querySelectorAll(".joining")) node.hidden = !joined;
  at("factor").value = Math.log10(shown.factor);
  for (const id of ["factor", "arrow"]) at(id).addEventListener("input", scaled);
  for (const id of ["show-own", "show-exact", "show-gaps", "show-forces"]) at(id).addEventListener("change", () => go(now));
  const lasts = times[count - 1] - times[0];
  at("speed").value = ["1", "0.5", "0.25", "0.1", "0.05"].find(speed => lasts / Number(speed) >= 4) || "0.01";

  now = 0;
  scaled();
  if (renderer) {
    at("stage").prepend(renderer.domElement);
    fit();
    dress();
    look();
    controls.addEventListener("change", () => { dirty = true; });
    at("reset").addEventListener("click", look);
    at("record").hidden = !("MediaRecorder" in window);
    at("record").addEventListener("click", () => { if (!recording) record(); });
    new ResizeObserver(() => { fit(); draw(); }).observe(at("stage"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", dress);
    const ray = new THREE.Raycaster(), spot = new THREE.Vector2();
    let pressed = [0, 0];
    renderer.domElement.addEventListener("pointerdown", event => { pressed = [event.clientX, event.clientY]; });
    renderer.domElement.addEventListener("pointerup", event => {
      if (Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
      const box = renderer.domElement.getBoundingClientRect();
      spot.set(2 * (event.clientX - box.left) / box.width - 1, 1 - 2 * (event.clientY - box.top) / box.height);
      ray.setFromCamera(spot, camera);
      const hit = ray.intersectObjects(clickable.filter(mesh => mesh.parent.parent.visible), false)[0];
      at("body").textContent = hit ? shown.scene.names[hit.object.userData.body] : "drag turns, wheel zooms, a click names a body";
    });
  }
  window.viewer = { go, play, sides, times, shown, get frame() { return now; }, get factor() { return factor; }, renderer, scene, camera, draw };
  go(0);
  tell();
  play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  requestAnimationFrame(tick);
})();
