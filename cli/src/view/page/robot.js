// The robot, drawn from its URDF: its pose, how much torque each joint carries, contact wrenches.

import {
  BoxGeometry, Box3, Color, ConeGeometry, CylinderGeometry, DirectionalLight, Euler, GridHelper, Group, HemisphereLight,
  Mesh, MeshLambertMaterial, OrbitControls, PerspectiveCamera, Quaternion, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from "./vendor/three.min.js";
import { css } from "./plots.js";

/** Least time between two pictures where the processor draws them, ms: it has the charts to draw, and the robot to run. */
const SLOW_PICTURES = 250;

/** Length of a force's arrow, m/N, and the least force that is drawn, N. */
const PER_NEWTON = 0.0012;
const LEAST_FORCE = 2;

const numbers = (text, fallback) => (text ? text.trim().split(/\s+/).map(Number) : fallback);

function place(object, origin) {
  const [x, y, z] = numbers(origin?.getAttribute("xyz"), [0, 0, 0]);
  const [roll, pitch, yaw] = numbers(origin?.getAttribute("rpy"), [0, 0, 0]);
  object.position.set(x, y, z);
  object.quaternion.setFromEuler(new Euler(roll, pitch, yaw, "ZYX"));
}

const child = (element, name) => [...element.children].find((c) => c.tagName === name);
const children = (element, name) => [...element.children].filter((c) => c.tagName === name);

function shape(geometry) {
  const [box, cylinder, sphere] = ["box", "cylinder", "sphere"].map((name) => child(geometry, name));
  if (box) return new BoxGeometry(...numbers(box.getAttribute("size")));
  const size = (of, name) => Number(of.getAttribute(name));
  if (cylinder) {
    const round = new CylinderGeometry(size(cylinder, "radius"), size(cylinder, "radius"), size(cylinder, "length"), 24);
    return round.rotateX(Math.PI / 2); // along z, as URDF has it
  }
  if (sphere) return new SphereGeometry(size(sphere, "radius"), 20, 14);
  return null; // a mesh: its file is not here
}

/** A rod from a frame to a point in it, for links that have no shape of their own. */
function rod(to, radius, material) {
  const length = to.length();
  const mesh = new Mesh(new CylinderGeometry(radius, radius, length, 10), material);
  mesh.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), to.clone().normalize());
  mesh.position.copy(to).multiplyScalar(0.5);
  return mesh;
}

function arrow(material) {
  const group = new Group();
  const shaft = new Mesh(new CylinderGeometry(0.008, 0.008, 1, 12).translate(0, 0.5, 0), material);
  const head = new Mesh(new ConeGeometry(0.024, 0.06, 16).translate(0, 0.03, 0), material);
  shaft.renderOrder = head.renderOrder = 1;
  group.add(shaft, head);
  group.point = (direction, length) => {
    group.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), direction);
    shaft.scale.y = Math.max(1e-3, length);
    head.position.y = length;
  };
  return group;
}

function isDrawnByProcessor(gl) {
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  return /swiftshader|llvmpipe|software/i.test(gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
}

export class Drawing {
  /** Throws if there is no WebGL. */
  constructor(element, scene) {
    this.scene3 = new Scene();
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.interval = isDrawnByProcessor(this.renderer.getContext()) ? SLOW_PICTURES : 0;
    this.next = 0;
    this.renderer.setPixelRatio(this.interval ? 1 : Math.min(2, devicePixelRatio));
    const canvas = this.renderer.domElement;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${scene.robot} in its present pose, with contact forces`);
    element.replaceChildren(canvas);
    this.element = element;
    this.camera = new PerspectiveCamera(35, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.sky = new HemisphereLight(0xffffff, 0x777788, 2.2);
    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.set(2, -3, 4);
    this.scene3.add(this.sky, sun);
    this.build(new DOMParser().parseFromString(scene.urdf, "text/xml"), scene);
    this.frame();
  }

  build(xml, scene) {
    const robot = xml.querySelector("robot");
    const links = new Map();
    for (const link of children(robot, "link")) {
      const group = new Group();
      const material = new MeshLambertMaterial({ color: 0x8a96a3 });
      group.userData = { link, material, drawn: 0 };
      for (const visual of children(link, "visual")) {
        const geometry = shape(child(visual, "geometry"));
        if (!geometry) continue;
        const mesh = new Mesh(geometry, material);
        place(mesh, child(visual, "origin"));
        group.add(mesh);
        group.userData.drawn += 1;
      }
      links.set(link.getAttribute("name"), group);
    }
    this.joints = scene.joints.map(() => null);
    const roots = new Set(links.values());
    for (const joint of children(robot, "joint")) {
      const [parent, below] = ["parent", "child"].map((name) => links.get(child(joint, name).getAttribute("link")));
      const frame = new Group();
      place(frame, child(joint, "origin"));
      if (!parent.userData.drawn && frame.position.length() > 1e-6) parent.add(rod(frame.position, 0.02, parent.userData.material));
      parent.add(frame);
      const moved = new Group();
      frame.add(moved);
      moved.add(below);
      roots.delete(below);
      const index = scene.joints.findIndex((j) => j.name === joint.getAttribute("name"));
      if (index < 0) continue;
      const axis = new Vector3(...numbers(child(joint, "axis")?.getAttribute("xyz"), [1, 0, 0])).normalize();
      this.joints[index] = { moved, axis, slides: joint.getAttribute("type") === "prismatic", material: below.userData.material, limit: scene.joints[index].torque_limit };
    }
    this.root = new Group();
    this.root.add(...roots);
    this.scene3.add(this.root);
    // Drawn over the robot: forces on a foot point into the leg.
    const ink = new MeshLambertMaterial({ color: 0xd81b60, emissive: 0x8a0f3c, depthTest: false, transparent: true });
    this.arrows = (scene.sensor_links ?? []).map((name) => {
      const one = arrow(ink);
      one.visible = false;
      links.get(name)?.add(one);
      return one;
    });
    this.useColours();
  }

  useColours() {
    [this.rest, this.high] = [new Color(css("--robot")), new Color(css("--limit"))];
    this.grid?.removeFromParent();
    const box = new Box3().setFromObject(this.root);
    const size = Math.max(0.5, box.getSize(new Vector3()).length());
    this.grid = new GridHelper(2 * size, 20, new Color(css("--edge")), new Color(css("--edge"))).rotateX(Math.PI / 2);
    this.grid.position.z = box.min.z;
    this.scene3.add(this.grid);
  }

  frame() {
    const box = new Box3().setFromObject(this.root);
    const middle = box.getCenter(new Vector3());
    const size = Math.max(0.3, box.getSize(new Vector3()).length());
    this.controls.target.copy(middle);
    this.camera.position.copy(middle).add(new Vector3(1.25, -0.95, 0.45).normalize().multiplyScalar(1.65 * size));
    this.controls.update();
  }

  /** Shows the row at a place in the store's columns. */
  show(store, place) {
    const now = performance.now();
    if (now < this.next) return;
    this.next = now + this.interval;
    const { clientWidth: width, clientHeight: height } = this.element;
    if (width && (this.width !== width || this.height !== height)) {
      [this.width, this.height] = [width, height];
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
    }
    if (place >= 0) {
      this.joints.forEach((joint, j) => {
        if (!joint) return;
        const q = store.joint(j, "q")[place];
        if (joint.slides) joint.moved.position.copy(joint.axis).multiplyScalar(q);
        else joint.moved.quaternion.copy(new Quaternion().setFromAxisAngle(joint.axis, q));
        const use = Math.abs(store.joint(j, "tau")[place]) / joint.limit || 0;
        joint.material.color.copy(this.rest).lerp(this.high, Math.min(1, use));
      });
      this.arrows.forEach((one, sensor) => {
        const force = new Vector3(...[0, 1, 2].map((axis) => store.wrench(sensor, axis)[place]));
        const size = force.length();
        one.visible = size > LEAST_FORCE;
        if (one.visible) one.point(force.divideScalar(size), size * PER_NEWTON);
      });
    }
    this.renderer.render(this.scene3, this.camera);
  }
}
