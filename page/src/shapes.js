// Guarded shapes: the arm's capsules, the planes and boxes around it, and the arm in the pose in which a
// refused path would make two of them overlap.

import {
  BoxGeometry, CapsuleGeometry, DoubleSide, Euler, Group, Mesh, MeshStandardMaterial, PlaneGeometry,
  Quaternion, Vector3,
} from "three";

const ALONG = new Vector3(0, 1, 0); // of a capsule
const FACING = new Vector3(0, 0, 1); // of a plane

export class Shapes {
  #robot; #arm = []; #around = new Group(); #there = new Group(); #plain = translucent(0.3);
  #met = translucent(0.7);

  /** Shapes for an arm of this size, in the format of the files; `walls` may be null. */
  constructor(robot, walls, size) {
    this.#robot = robot;
    for (const { name, joint, start, end, radius } of walls?.shapes.capsules ?? []) {
      const capsule = named(name, between(new Vector3(...start), new Vector3(...end), radius, this.#plain));
      this.#arm.push(capsule);
      (robot.joints[joint] ?? robot).add(capsule); // on the root if no joint moves it
    }
    for (const [name, { point, normal }] of Object.entries(walls?.surroundings.planes ?? {})) {
      const unit = new Vector3(...normal).normalize();
      const plane = named(name, new Mesh(new PlaneGeometry(2 * size, 2 * size), this.#plain));
      plane.position.copy(unit).multiplyScalar(unit.dot(new Vector3(...point))); // its point nearest to the root
      plane.quaternion.setFromUnitVectors(FACING, unit);
      this.#around.add(plane);
    }
    for (const [name, { centre, size: edges, rpy }] of Object.entries(walls?.surroundings.boxes ?? {})) {
      const box = named(name, new Mesh(new BoxGeometry(...edges), this.#plain));
      box.position.set(...centre);
      box.setRotationFromEuler(new Euler(...rpy, "ZYX"));
      this.#around.add(box);
    }
    this.#around.rotation.copy(robot.rotation); // in its frame, but not part of what must be in the picture
    robot.parent.add(this.#around, this.#there);
    this.show(false);
  }

  show(shown) {
    for (const part of [this.#around, ...this.#arm]) part.visible = shown;
  }

  remove() {
    for (const group of [this.#around, this.#there]) group.removeFromParent();
  }

  /** Draw the arm with its load in the pose of a meeting, beside its present pose, or remove it. */
  refuse(meeting, names, load) {
    this.#there.clear();
    if (!meeting) return;
    const stood = names.map((name) => this.#robot.joints[name].angle);
    const pose = (angles) => names.forEach((name, i) => this.#robot.setJointValue(name, angles[i]));
    pose(meeting.position);
    for (const part of [this.#robot, this.#around]) part.updateMatrixWorld(true);
    const parts = [...this.#arm, ...this.#around.children, ...(load ? [named("payload", load)] : [])];
    for (const part of parts) {
      const lit = meeting.pair.includes(part.name);
      if (!lit && this.#around.children.includes(part)) continue;
      const there = new Mesh(part.geometry, lit ? this.#met : this.#plain);
      there.matrixAutoUpdate = false;
      there.matrix.copy(part.matrixWorld);
      this.#there.add(there);
    }
    pose(stood);
  }

  paint(plain, met) {
    this.#plain.color.copy(plain);
    this.#met.color.copy(met);
  }
}

function named(name, mesh) {
  mesh.name = name;
  return mesh;
}

function between(start, end, radius, material) {
  const span = end.clone().sub(start), mesh = new Mesh(new CapsuleGeometry(radius, span.length(), 8, 20), material);
  mesh.position.copy(start).addScaledVector(span, 0.5);
  if (span.length() > 0) mesh.quaternion.copy(new Quaternion().setFromUnitVectors(ALONG, span.normalize()));
  return mesh;
}

function translucent(opacity) {
  return new MeshStandardMaterial({ roughness: 0.6, transparent: true, opacity, depthWrite: false, side: DoubleSide });
}
