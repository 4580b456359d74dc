// Shapes that walls guard: the arm's capsules, the planes and boxes around it, and the arm where a path that
// was refused would lead two of them through each other.

import {
  BoxGeometry, CapsuleGeometry, DoubleSide, Euler, Group, Mesh, MeshStandardMaterial, PlaneGeometry,
  Quaternion, Vector3,
} from "three";

const ALONG = new Vector3(0, 1, 0); // of a capsule
const FACING = new Vector3(0, 0, 1); // of a plane

export class Shapes {
  #robot; #arm = []; #around = new Group(); #there = new Group(); #plain = glass(0.3);
  #met = glass(0.7);

  /** Shapes of an arm of this size, in the files' words, or none. */
  constructor(robot, walls, size) {
    this.#robot = robot;
    for (const { name, joint, start, end, radius } of walls?.shapes.capsules ?? []) {
      const capsule = named(name, between(new Vector3(...start), new Vector3(...end), radius, this.#plain));
      this.#arm.push(capsule);
      (robot.joints[joint] ?? robot).add(capsule); // of the root where no joint moves it
    }
    for (const [name, { point, normal }] of Object.entries(walls?.surroundings.planes ?? {})) {
      const way = new Vector3(...normal).normalize();
      const plane = named(name, new Mesh(new PlaneGeometry(2 * size, 2 * size), this.#plain));
      plane.position.copy(way).multiplyScalar(way.dot(new Vector3(...point))); // nearest to the root
      plane.quaternion.setFromUnitVectors(FACING, way);
      this.#around.add(plane);
    }
    for (const [name, { centre, size: edges, rpy }] of Object.entries(walls?.surroundings.boxes ?? {})) {
      const box = named(name, new Mesh(new BoxGeometry(...edges), this.#plain));
      box.position.set(...centre);
      box.setRotationFromEuler(new Euler(...rpy, "ZYX"));
      this.#around.add(box);
    }
    this.#around.rotation.copy(robot.rotation); // in its frame, but no part of what the picture is to have
    robot.parent.add(this.#around, this.#there);
    this.show(false);
  }

  show(shown) {
    for (const part of [this.#around, ...this.#arm]) part.visible = shown;
  }

  remove() {
    for (const group of [this.#around, this.#there]) group.removeFromParent();
  }

  /** Draw the arm with its load at the place of a meeting, beside it as it stands, or take it off. */
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
  const way = end.clone().sub(start), mesh = new Mesh(new CapsuleGeometry(radius, way.length(), 8, 20), material);
  mesh.position.copy(start).addScaledVector(way, 0.5);
  if (way.length() > 0) mesh.quaternion.copy(new Quaternion().setFromUnitVectors(ALONG, way.normalize()));
  return mesh;
}

function glass(opacity) {
  return new MeshStandardMaterial({ roughness: 0.6, transparent: true, opacity, depthWrite: false, side: DoubleSide });
}
