"use strict";
// The moving arm: hull meshes on the kinematic tree, the scene, the tool's path; one clock for all arms that are shown.
class Player {
  constructor(place, data) {
    this.data = data;
    this.time = 0;
    this.playing = false;
    this.onTime = null;
    this.longest = Math.max(...data.motions.map((m) => m.time[m.time.length - 1]));
    this.build(place);
  }

  build(place) {
    this.canvas = document.createElement("canvas");
    place.append(this.canvas);
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: true, preserveDrawingBuffer: true }); // kept: for print
    this.world = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(38, 2, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.world.add(new THREE.HemisphereLight(0xffffff, 0x8899aa, 0.9));
    const sun = new THREE.DirectionalLight(0xffffff, 0.6);
    sun.position.set(2, -3, 5);
    this.world.add(sun);
    const grid = new THREE.GridHelper(4, 20, 0x8899aa, 0xaab4c0);
    grid.rotation.x = Math.PI / 2;
    grid.material.transparent = true;
    grid.material.opacity = 0.35;
    this.world.add(grid);
    this.pair = [];
    for (const object of this.data.scene) this.world.add(this.mesh(object, "#8d99a6", object.surface ? 0.3 : 0.55));
    this.arms = this.data.motions.map((motion) => this.arm(motion));
    this.aim();
    this.bar(place);
    this.pointer();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    this.seek(0);
  }

  // A surface is seen from its free side only; ghosts lie behind what they coincide with.
  mesh(body, colour, opacity, ghost) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(body.vertices.flat()), 3));
    geometry.setIndex(body.faces.flat());
    const flat = geometry.toNonIndexed();
    flat.computeVertexNormals();
    const material = new THREE.MeshLambertMaterial({ color: colour, transparent: opacity < 1, opacity, side: body.surface ? THREE.FrontSide : THREE.DoubleSide, depthWrite: opacity >= 0.6 });
    if (ghost) Object.assign(material, { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    else if (this.data.closest && this.data.closest.pair.includes(body.name)) this.pair.push(material);
    return new THREE.Mesh(flat, material);
  }

  arm(motion) {
    const root = new THREE.Group(), turning = [];
    const opacity = motion.ghost ? 0.35 : 1;
    for (const joint of this.data.tree) {
      const fixed = new THREE.Group(), free = new THREE.Group();
      fixed.matrixAutoUpdate = false;
      fixed.matrix.set(...joint.placement.flat());
      fixed.add(free);
      (joint.parent < 0 ? root : turning[joint.parent]).add(fixed);
      turning.push(free);
    }
    for (const body of this.data.bodies) {
      (body.joint < 0 ? root : turning[body.joint]).add(this.mesh(body, body.colour ?? motion.colour, opacity, motion.ghost));
    }
    const group = new THREE.Group();
    group.add(root);
    for (const tool of motion.tools) {
      const points = tool.map((p) => new THREE.Vector3(...p));
      group.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineBasicMaterial({ color: motion.colour })));
    }
    group.visible = motion.shown;
    this.world.add(group);
    return { group, turning, motion };
  }

  aim() {
    const box = new THREE.Box3();
    for (const arm of this.arms) for (const p of arm.motion.tools.flat()) box.expandByPoint(new THREE.Vector3(...p));
    box.expandByPoint(new THREE.Vector3(0, 0, 0));
    this.centre = box.getCenter(new THREE.Vector3());
    this.view = { azimuth: -0.9, elevation: 0.35, distance: Math.max(1.1, 1.7 * box.getSize(new THREE.Vector3()).length()) };
  }

  bar(place) {
    const bar = document.createElement("div");
    bar.className = "controls";
    this.button = document.createElement("button");
    this.button.textContent = "play";
    this.button.onclick = () => this.toggle();
    this.slider = document.createElement("input");
    Object.assign(this.slider, { type: "range", min: 0, max: this.longest, step: this.longest / 1000, value: 0 });
    this.slider.setAttribute("aria-label", "time");
    this.slider.oninput = () => { this.playing = false; this.seek(Number(this.slider.value)); };
    this.label = document.createElement("span");
    this.label.className = "time";
    this.speed = document.createElement("select");
    this.speed.setAttribute("aria-label", "playback speed");
    for (const factor of [0.1, 0.25, 0.5, 1, 2, 5]) this.speed.append(new Option(`${factor}×`, factor, factor === 1, factor === 1));
    bar.append(this.button, this.slider, this.label, this.speed);
    if (this.data.closest) {
      const jump = document.createElement("button");
      jump.className = "closest";
      jump.textContent = this.data.closest.label;
      jump.onclick = () => { this.playing = false; this.seek(this.data.closest.time); };
      bar.append(jump);
    }
    if (this.arms.length > 3) this.chooser(bar); else this.switches(bar);
    place.append(bar);
  }

  switches(bar) {
    for (const arm of this.arms) {
      const label = document.createElement("label"), box = document.createElement("input"), patch = document.createElement("i");
      box.type = "checkbox";
      box.checked = arm.group.visible;
      box.onchange = () => { arm.group.visible = box.checked; this.draw(); };
      patch.style.background = arm.motion.colour;
      label.append(box, patch, arm.motion.name);
      bar.append(label);
    }
  }

  chooser(bar) {
    const select = document.createElement("select");
    this.arms.forEach((arm, k) => select.append(new Option(arm.motion.name, k, false, arm.group.visible)));
    select.onchange = () => {
      this.arms.forEach((arm, k) => { arm.group.visible = k === Number(select.value); });
      this.seek(0);
    };
    bar.append(select);
  }

  pointer() {
    let held = null;
    this.canvas.onpointerdown = (e) => { held = [e.clientX, e.clientY]; this.canvas.setPointerCapture(e.pointerId); };
    this.canvas.onpointerup = () => { held = null; };
    this.canvas.onpointermove = (e) => {
      if (!held) return;
      this.view.azimuth -= 0.008 * (e.clientX - held[0]);
      this.view.elevation = Math.min(1.55, Math.max(-1.2, this.view.elevation + 0.008 * (e.clientY - held[1])));
      held = [e.clientX, e.clientY];
      this.draw();
    };
    this.canvas.onwheel = (e) => {
      e.preventDefault();
      this.view.distance = Math.min(20, Math.max(0.2, this.view.distance * Math.exp(0.001 * e.deltaY)));
      this.draw();
    };
  }

  toggle() {
    this.playing = !this.playing;
    if (this.playing && this.time >= this.longest) this.seek(0);
    let before = performance.now();
    const step = (now) => {
      if (!this.playing) { this.button.textContent = "play"; return; }
      this.seek(Math.min(this.longest, this.time + Number(this.speed.value) * (now - before) / 1000));
      before = now;
      if (this.time >= this.longest) this.playing = false;
      requestAnimationFrame(step);
    };
    this.button.textContent = this.playing ? "pause" : "play";
    if (this.playing) requestAnimationFrame(step);
  }

  seek(time) {
    this.time = Math.min(this.longest, Math.max(0, time));
    for (const arm of this.arms) if (arm.group.visible) this.pose(arm);
    this.slider.value = this.time;
    this.label.textContent = this.time.toFixed(3) + " s";
    const phase = this.data.phases.filter((p) => p.time <= this.time + 1e-9).pop();
    if (phase) this.label.textContent += " · " + phase.name;
    const near = this.data.closest && Math.abs(this.time - this.data.closest.time) < 0.02 * this.longest;
    for (const material of this.pair) material.emissive.set(near ? styleOf("--near") : "#000000");
    if (this.onTime) this.onTime(this.time);
    this.draw();
  }

  pose(arm) {
    const { time, position } = arm.motion;
    let k = 0;
    while (k < time.length - 2 && time[k + 1] <= this.time) k += 1;
    const share = Math.min(1, Math.max(0, (this.time - time[k]) / (time[k + 1] - time[k] || 1)));
    this.data.tree.forEach((joint, j) => {
      const q = position[k][j] + share * (position[k + 1][j] - position[k][j]), axis = new THREE.Vector3(...joint.axis);
      if (joint.prismatic) arm.turning[j].position.copy(axis.multiplyScalar(q));
      else arm.turning[j].quaternion.setFromAxisAngle(axis, q);
    });
  }

  draw() {
    const width = this.canvas.clientWidth || 800, height = this.canvas.clientHeight || 480;
    this.renderer.setPixelRatio(window.devicePixelRatio || 1);
    this.renderer.setSize(width, height, false);
    this.renderer.setClearColor(styleOf("--panel") || "#f5f7f9");
    this.camera.aspect = width / height;
    const { azimuth, elevation, distance } = this.view, flat = distance * Math.cos(elevation);
    this.camera.position.set(this.centre.x + flat * Math.cos(azimuth), this.centre.y + flat * Math.sin(azimuth), this.centre.z + distance * Math.sin(elevation));
    this.camera.lookAt(this.centre);
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.world, this.camera);
    this.canvas.dataset.drawn = "yes";
  }
}
