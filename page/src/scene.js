// The arm in three dimensions: drawn from its URDF, with capsules for links without shapes, the touched link
// highlighted, and an arc arrow around each joint whose residual is beyond its level.

import {
  AmbientLight, BoxGeometry, CapsuleGeometry, Color, ConeGeometry, DirectionalLight, GridHelper, Group, Mesh,
  MeshStandardMaterial, PerspectiveCamera, Quaternion, Scene as Space, SphereGeometry, TorusGeometry,
  Vector3, WebGLRenderer, Box3,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import URDFLoader from "urdf-loader";
import { Shapes } from "./shapes.js";
import { isBeyond } from "./words.js";

const EVERY_MS = 33;
const FRAME_EVERY_MS = 500;
const LEAST_LINK = 0.02; // m: shorter links are drawn as balls
const UP = new Vector3(0, 1, 0);
const ARC = 1.6 * Math.PI; // extent of a torque's arrow
const LARGEST_ARROW = 2; // multiple of its normal size
const POSES = 240; // all of which must be in the picture
const AWAY = new Vector3(1, 0.5, 0.8).normalize(); // from the arm to the camera
const RIGHT = new Vector3().crossVectors(UP, AWAY).normalize();
const ABOVE = new Vector3().crossVectors(AWAY, RIGHT);

export class Scene {
  #host; #url; #say; #renderer; #space = new Space(); #camera; #controls; #robot = null;
  #joints = []; #touched = ""; #carried = null; #load = null; #drawn_ms = 0; #size = 1; #names;
  #colours = new Color(0xd06030); #force = null; #felt = null; #place; #touch = null; #point = null;
  #seen = new Box3(); #corners = []; #framed_ms = 0; #turned = false;
  #walls = null; #shapes = null; #meeting = null; #shown = false;

  constructor(host, url, say) {
    this.#host = host;
    this.#url = url;
    this.#say = say;
    this.#renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.#renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    host.replaceChildren(this.#renderer.domElement);
    this.#camera = new PerspectiveCamera(40, 1, 0.01, 100);
    this.#controls = new OrbitControls(this.#camera, this.#renderer.domElement);
    this.#controls.addEventListener("start", () => (this.#turned = true));
    this.#controls.addEventListener("change", () => this.#now());
    this.#controls.enableZoom = false; // the wheel scrolls the page
    this.#light();
    new ResizeObserver(() => this.#resize()).observe(host);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#recolour());
  }

  /** Build the arm; again after the daemon restarted, since it may be another arm. */
  async begin({ joints, force_axes, force_point, walls }) {
    this.#names = joints;
    this.#walls = walls;
    this.#place = { link: force_axes, point: force_point };
    const description = await readXml(this.#url);
    if (description === null) return this.#say("The arm's description cannot be read.");
    const loader = new URDFLoader();
    // Meshes are files on the robot's computer, which are not served to this page.
    loader.loadMeshCb = (path, manager, material, done) => done(new Group());
    for (const visual of description.querySelectorAll("visual")) {
      if (!visual.querySelector(":scope > geometry > *")) visual.remove();
    }
    try {
      this.#build(loader.parse(description));
      this.#say("");
    } catch (error) {
      this.#say(`The arm's description cannot be drawn: ${error.message}.`);
    }
    return undefined;
  }

  words(words) {
    this.#touched = words.touched;
    this.#carried = words.load ?? null;
    this.#felt = words.force ?? null;
    this.#touch = words.touch ?? null;
    this.#meeting = words.meeting ?? null;
    this.#carry();
    this.#refuse();
    this.#mark();
    this.#push();
  }

  /** Show the guarded shapes, or hide them. */
  show(shapes) {
    this.#shown = shapes;
    this.#shapes?.show(shapes);
    this.#now();
  }

  #refuse() {
    this.#shapes?.refuse(this.#meeting, this.#names, this.#load);
    this.#host.dataset.meeting = this.#meeting?.pair.join(" ") ?? "";
  }

  /** Draw the pose and the contacts of a tick. */
  draw(tick) {
    const now = performance.now();
    if (this.#robot === null || now - this.#drawn_ms < EVERY_MS || this.#host.clientWidth === 0) return;
    if (now - this.#framed_ms > FRAME_EVERY_MS) this.#follow(now);
    const names = this.#names;
    names.forEach((name, i) => this.#robot.setJointValue(name, tick.link_position[i]));
    for (const joint of this.#joints) {
      const i = names.indexOf(joint.name);
      if (i < 0) continue;
      const beyond = isBeyond(tick, i);
      joint.light(joint.name === this.#touched, beyond);
      joint.feel(beyond ? tick.residual[i] / tick.threshold[i] : 0);
    }
    this.#drawn_ms = now;
    this.#renderer.render(this.#space, this.#camera);
    this.#host.dataset.lit = this.#touched;
    this.#host.dataset.arrows = this.#joints.filter((joint) => joint.arrow.visible).length;
  }

  /** Draw the load at its place in the last link's frame, or remove it. */
  #carry() {
    this.#load?.removeFromParent();
    this.#load = null;
    const hand = this.#joints.at(-1)?.joint.children.find((child) => child.isURDFLink);
    if (this.#carried === null || hand === undefined) return;
    // Twice the radius of the same mass of water.
    const radius = 2 * Math.cbrt((3 * this.#carried.mass) / (4e3 * Math.PI));
    const material = new MeshStandardMaterial({ color: 0x9a6bd0, wireframe: !this.#carried.announced });
    const { box } = this.#carried;
    this.#load = new Mesh(box ? new BoxGeometry(...box) : new SphereGeometry(radius, 16, 12), material);
    this.#load.position.set(...this.#carried.com);
    hand.add(this.#load);
  }

  /** Draw an arrow for the force at the tool, with the cone of its uncertainty, or remove it. */
  #push() {
    this.#force?.removeFromParent();
    this.#force = null;
    const link = this.#robot?.links[this.#place.link];
    this.#host.dataset.force = this.#felt?.text ?? "";
    if (this.#felt === null || link === undefined) return;
    const length = this.#size * Math.min(0.1 + 0.01 * this.#felt.size, 0.5);
    this.#force = force(length, this.#felt.cone, this.#colours);
    this.#force.position.set(...this.#place.point);
    this.#force.quaternion.setFromUnitVectors(UP, new Vector3(...this.#felt.way).normalize());
    link.add(this.#force);
  }

  /** Mark the point of contact with a ball as large as its uncertainty, or remove it. */
  #mark() {
    this.#point?.removeFromParent();
    this.#point = null;
    const link = this.#robot?.links[this.#touch?.link];
    this.#host.dataset.touch = this.#touch?.text ?? "";
    if (link === undefined) return;
    this.#point = new Mesh(new SphereGeometry(this.#touch.doubt, 24, 16), translucent(this.#colours));
    this.#point.position.set(...this.#touch.point);
    link.add(this.#point);
  }

  #now() {
    if (this.#robot !== null) this.#renderer.render(this.#space, this.#camera);
  }

  #light() {
    this.#space.add(new AmbientLight(0xffffff, 1.6));
    for (const [x, y, z, strength] of [[2, 4, 3, 2.2], [-3, 2, -2, 0.8]]) {
      const light = new DirectionalLight(0xffffff, strength);
      light.position.set(x, y, z);
      this.#space.add(light);
    }
  }

  #build(robot) {
    if (this.#robot !== null) this.#space.remove(this.#robot, this.grid);
    this.#shapes?.remove();
    robot.rotation.x = -Math.PI / 2; // z is up in URDF, y in three.js
    robot.updateMatrixWorld(true);
    this.#robot = robot;
    this.#space.add(robot);
    this.#size = reach(robot);
    this.#joints = Object.values(robot.joints)
      .filter((joint) => joint.jointType !== "fixed")
      .map((joint) => new Joint(joint, this.#size));
    addCapsules(robot, this.#size, this.#joints);
    this.grid = new GridHelper(2 * this.#size, 12, 0x888888, 0x888888);
    this.grid.material.transparent = true;
    this.grid.material.opacity = 0.25;
    this.#space.add(this.grid);
    this.#carry();
    this.#push();
    this.#shapes = new Shapes(robot, this.#walls, this.#size);
    this.#shapes.show(this.#shown);
    this.#survey();
    this.#refuse();
    this.#recolour();
    this.#resize();
  }

  /** Note the corners of everything drawn, in poses at and within the limits, with the largest arrows. */
  #survey() {
    this.#corners = [];
    this.#seen.makeEmpty();
    const shares = sequence();
    for (const joint of this.#joints) joint.arrow.scale.setScalar(LARGEST_ARROW);
    for (let k = 0; k < POSES; k++) {
      for (const { joint } of this.#joints) {
        const turns = joint.jointType === "continuous";
        const [lower, upper] = turns ? [-Math.PI, Math.PI] : [joint.limit.lower, joint.limit.upper];
        // Often at a limit, where an arm reaches furthest.
        const share = Math.min(Math.max(1.6 * shares.next().value - 0.3, 0), 1);
        joint.setJointValue(k === 0 ? 0 : lower + share * (upper - lower));
      }
      this.#robot.updateMatrixWorld(true);
      this.#robot.traverse((part) => part.isMesh && this.#note(part));
    }
    for (const { joint, arrow } of this.#joints) {
      joint.setJointValue(0);
      arrow.scale.setScalar(1);
    }
    this.#frame();
  }

  #note(mesh) {
    if (mesh.geometry.boundingBox === null) mesh.geometry.computeBoundingBox();
    for (const corner of cornersOf(mesh.geometry.boundingBox)) {
      this.#corners.push(corner.applyMatrix4(mesh.matrixWorld));
      this.#seen.expandByPoint(corner);
    }
  }

  /** Extend the picture to a pose that lies outside the surveyed ones. */
  #follow(now) {
    this.#framed_ms = now;
    const box = new Box3().setFromObject(this.#robot);
    if (this.#seen.containsBox(box)) return;
    this.#seen.union(box);
    this.#corners.push(...cornersOf(box));
    this.#frame();
  }

  /** Move the camera as near as all corners in the picture permit; if a person turned it, leave it. */
  #frame() {
    if (this.#turned || this.#corners.length === 0) return;
    const high = Math.tan((0.5 * this.#camera.fov * Math.PI) / 180);
    const wide = high * this.#camera.aspect;
    const seen = new Box3().setFromPoints(this.#corners.map(ofCamera));
    const middle = seen.getCenter(new Vector3());
    const needs = ({ x, y, z }) =>
      z - middle.z + Math.max(Math.abs(x - middle.x) / wide, Math.abs(y - middle.y) / high);
    const far = 1.05 * this.#corners.reduce((most, corner) => Math.max(most, needs(ofCamera(corner))), 0);
    this.#controls.target.set(0, 0, 0).addScaledVector(RIGHT, middle.x).addScaledVector(ABOVE, middle.y)
      .addScaledVector(AWAY, middle.z);
    this.#camera.position.copy(AWAY).multiplyScalar(far).add(this.#controls.target);
    this.#controls.update();
    this.grid.position.y = this.#seen.min.y;
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.#host;
    if (!width || !height) return;
    this.#camera.aspect = width / height;
    this.#camera.updateProjectionMatrix();
    this.#frame();
    this.#renderer.setSize(width, height);
    this.#now();
  }

  #recolour() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => new Color(style.getPropertyValue(name).trim());
    this.#colours = colour("--felt");
    for (const joint of this.#joints) {
      joint.colours = { plain: colour("--link"), felt: colour("--felt"), touched: colour("--touched") };
      joint.paint();
    }
    this.#shapes?.paint(colour("--residual"), colour("--bad"));
    this.#now();
  }
}

/** The eight corners of a box. */
function cornersOf({ min, max }) {
  return [0, 1, 2, 3, 4, 5, 6, 7].map(
    (k) => new Vector3(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z));
}

/** A point in the camera's axes. */
function ofCamera(point) {
  return new Vector3(point.dot(RIGHT), point.dot(ABOVE), point.dot(AWAY));
}

/** Numbers from 0 to 1, the same for every arm (a linear congruential generator). */
function* sequence() {
  for (let state = 1; ; state = (1664525 * state + 1013904223) % 2 ** 32) yield state / 2 ** 32;
}

/** XML document at `url`, null if there is none. The request parses it, since trusted types refuse strings. */
function readXml(url) {
  return new Promise((resolve) => {
    const request = new XMLHttpRequest();
    request.open("GET", url);
    request.responseType = "document";
    request.onloadend = () => resolve(request.status === 200 ? request.responseXML : null);
    request.send();
  });
}

/** What is drawn for one joint: the shapes of its link, and its torque's arrow. */
class Joint {
  #lit = ""; shapes = []; colours = null;

  constructor(joint, size) {
    this.name = joint.urdfName ?? joint.name;
    this.joint = joint;
    this.material = new MeshStandardMaterial({ roughness: 0.55, metalness: 0.1 });
    this.mark = new MeshStandardMaterial({ roughness: 0.4 });
    this.arrow = arrow(0.09 * size, this.mark);
    this.arrow.quaternion.setFromUnitVectors(new Vector3(0, 0, 1), joint.axis.clone().normalize());
    this.arrow.visible = false;
    joint.add(this.arrow);
  }

  light(touched, felt) {
    const lit = touched ? "touched" : felt ? "felt" : "plain";
    if (lit === this.#lit) return;
    this.#lit = lit;
    this.paint();
  }

  paint() {
    if (this.colours === null) return;
    this.material.color.copy(this.colours[this.#lit || "plain"]);
    this.material.emissive.copy(this.colours.touched).multiplyScalar(this.#lit === "touched" ? 0.45 : 0);
    this.mark.color.copy(this.colours.felt);
  }

  /** Show a torque, as a signed multiple of its level; 0 hides the arrow. */
  feel(share) {
    this.arrow.visible = share !== 0;
    if (share === 0) return;
    const scale = Math.min(1 + 0.25 * (Math.abs(share) - 1), LARGEST_ARROW);
    this.arrow.scale.set(scale, scale, scale * Math.sign(share));
  }
}

/** Arc arrow around the z axis, right-handed. */
function arrow(radius, material) {
  const group = new Group();
  group.add(new Mesh(new TorusGeometry(radius, 0.11 * radius, 8, 40, ARC), material));
  const head = new Mesh(new ConeGeometry(0.32 * radius, 0.7 * radius, 14), material);
  head.position.set(radius * Math.cos(ARC), radius * Math.sin(ARC), 0);
  head.rotation.z = ARC;
  group.add(head);
  return group;
}

/** Straight arrow along the y axis whose head ends at the origin, and the cone of its uncertainty around
 * the shaft. */
function force(length, cone, colour) {
  const group = new Group(), material = new MeshStandardMaterial({ color: colour, roughness: 0.4 });
  const thick = 0.04 * length, head = new Mesh(new ConeGeometry(3 * thick, 0.25 * length, 16), material);
  head.position.y = -0.125 * length;
  const shaft = new Mesh(new CapsuleGeometry(thick, 0.8 * length, 4, 12), material);
  shaft.position.y = -0.6 * length;
  const half = Math.min(cone, 1.3), shape = [length * Math.sin(half), length * Math.cos(half), 24, 1, true];
  const doubt = new Mesh(new ConeGeometry(...shape), translucent(colour));
  doubt.position.y = -0.5 * length * Math.cos(half);
  group.add(head, shaft, doubt);
  return group;
}

/** Translucent material for uncertainties. */
function translucent(color) {
  return new MeshStandardMaterial({ color, roughness: 0.4, transparent: true, opacity: 0.25, depthWrite: false });
}

/** Give every link without shapes a capsule to each of its child joints; the last link one along its centre of mass. */
function addCapsules(robot, size, joints) {
  const radius = 0.035 * size;
  for (const link of Object.values(robot.links)) {
    const owner = joints.find((one) => one.joint.children.includes(link));
    const material = owner?.material ?? new MeshStandardMaterial({ color: 0x8a8f98, roughness: 0.7 });
    let hasShapes = false;
    for (const visual of link.children.filter((child) => child.isURDFVisual)) {
      visual.traverse((part) => {
        if (!part.isMesh) return;
        part.material = material;
        hasShapes = true;
      });
    }
    if (hasShapes) continue;
    const ends = link.children.filter((child) => child.isURDFJoint).map((joint) => joint.position.clone());
    if (ends.length === 0) ends.push(endOf(link));
    for (const end of ends) link.add(capsule(end, radius, material));
  }
}

/** Twice the position of the centre of mass: roughly the end of a link without child joints. */
function endOf(link) {
  const origin = link.urdfNode?.querySelector(":scope > inertial > origin")?.getAttribute("xyz");
  const numbers = (origin ?? "0 0 0").trim().split(/\s+/).map(Number);
  return new Vector3(...numbers).multiplyScalar(2);
}

function capsule(end, radius, material) {
  const length = end.length();
  if (length < LEAST_LINK) return new Mesh(new SphereGeometry(1.15 * radius, 20, 14), material);
  const mesh = new Mesh(new CapsuleGeometry(radius, length, 6, 16), material);
  mesh.position.copy(end).multiplyScalar(0.5);
  mesh.quaternion.copy(new Quaternion().setFromUnitVectors(UP, end.clone().normalize()));
  return mesh;
}

/** Length of the stretched arm [m]: the largest sum of distances between joints. */
function reach(robot) {
  const along = (part) =>
    Math.max(0, ...part.children.filter((child) => child.isURDFJoint || child.isURDFLink)
      .map((child) => child.position.length() + along(child)));
  return Math.max(along(robot), 0.2);
}
