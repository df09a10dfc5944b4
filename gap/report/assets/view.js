"use strict";
// The robot in three dimensions, by WebGL and nothing else: what it is made of is in the page.
const robotView = (() => {
  const vectors = {
    add: (a, b) => a.map((x, k) => x + b[k]),
    less: (a, b) => a.map((x, k) => x - b[k]),
    times: (a, s) => a.map((x) => x * s),
    dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
    cross: (a, b) => [
      a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
    unit: (a) => vectors.times(a, 1 / (Math.hypot(...a) || 1)),
  };
  const {add, less, times, dot, cross, unit} = vectors;

  // Quaternions have their real part first, as MuJoCo's.
  const product = ([a, b, c, d], [w, x, y, z]) => [
    a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y,
    a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w];
  const turned = ([w, ...v], p) => {
    const t = times(cross(v, p), 2);
    return add(add(p, times(t, w)), cross(v, t));
  };
  const about = (axis, angle) => [Math.cos(angle / 2), ...times(axis, Math.sin(angle / 2))];

  // The pose of every body, as mj_kinematics finds it; null where a position is none.
  const poses = (scene, qpos) => {
    if (qpos.some((q) => q === null || Number.isNaN(q))) return null;
    const found = [];
    scene.bodies.forEach((body, index) => {
      const parent = index ? found[body.parent] : {pos: [0, 0, 0], quat: [1, 0, 0, 0]};
      let pos = add(parent.pos, turned(parent.quat, body.pos));
      let quat = product(parent.quat, body.quat);
      for (const joint of body.joints) {
        const q = qpos.slice(joint.at, joint.at + 7);
        if (joint.type === "free") {
          pos = q.slice(0, 3);
          quat = unit(q.slice(3, 7));
        } else if (joint.type === "slide") {
          pos = add(pos, times(turned(quat, joint.axis), q[0] - joint.ref));
        } else {
          const anchor = add(pos, turned(quat, joint.pos));
          const ball = joint.type === "ball";
          quat = product(quat, ball ? unit(q.slice(0, 4)) : about(joint.axis, q[0] - joint.ref));
          pos = less(anchor, turned(quat, joint.pos));
        }
      }
      found.push({pos, quat: unit(quat)});
    });
    return found;
  };

  // Positions in a frame. Errors may be drawn larger than they are: measured + factor × error.
  const positions = (scene, motion, which, frame, factor) => {
    const qpos = [...scene.qpos];
    motion.addresses.forEach((address, k) => {
      const measured = motion.measured[k][frame];
      const value = motion[which][k][frame];
      const scaled = which !== "measured" && factor !== 1;
      if (value === null || (scaled && measured === null)) qpos[address] = null;
      else qpos[address] = scaled ? measured + factor * (value - measured) : value;
    });
    return qpos;
  };

  const ROUND = 20;
  // Triangles of what a profile of [radius, height] sweeps about the z axis.
  const revolved = (profile) => {
    const ring = Array.from({length: ROUND + 1}, (_, k) => {
      const angle = 2 * Math.PI * k / ROUND;
      return [Math.cos(angle), Math.sin(angle)];
    });
    const at = ([r, z], [c, s]) => [r * c, r * s, z];
    const triangles = [];
    for (let i = 1; i < profile.length; i++) {
      for (let k = 1; k <= ROUND; k++) {
        const [a, b] = [at(profile[i - 1], ring[k - 1]), at(profile[i - 1], ring[k])];
        const [c, d] = [at(profile[i], ring[k - 1]), at(profile[i], ring[k])];
        triangles.push(a, b, c, b, d, c);
      }
    }
    return triangles;
  };
  const arc = (radius, half) => Array.from({length: ROUND / 2 + 2}, (_, k) => {
    const upper = k > ROUND / 4;
    const angle = Math.PI * ((k - upper) / (ROUND / 2) - 0.5);
    return [radius * Math.cos(angle), radius * Math.sin(angle) + (upper ? half : -half)];
  });
  const box = ([x, y, z]) => {
    const corner = (k) => [k & 1 ? x : -x, k & 2 ? y : -y, k & 4 ? z : -z];
    const sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    return sides.flatMap(([a, b, c, d]) => [a, b, c, a, c, d].map(corner));
  };
  const triangles = (geom, meshes) => {
    const [a, b, c] = geom.size;
    switch (geom.shape) {
      case "sphere": return revolved(arc(a, 0));
      case "capsule": return revolved(arc(a, b));
      case "ellipsoid": return revolved(arc(1, 0)).map((p) => [p[0] * a, p[1] * b, p[2] * c]);
      case "cylinder": return revolved([[0, -b], [a, -b], [a, b], [0, b]]);
      case "box": return box(geom.size);
      default: {
        const {vertices, faces} = meshes[geom.mesh];
        return faces.map((k) => vertices.map((column) => column[k]));
      }
    }
  };

  // Matrices are columns one after the other, as WebGL's.
  const multiplied = (a, b) => Array.from({length: 16}, (_, k) => {
    const [row, column] = [k % 4, k - k % 4];
    return [0, 1, 2, 3].reduce((sum, i) => sum + a[row + 4 * i] * b[column + i], 0);
  });
  const placed = ({pos, quat}) => {
    const columns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => [...turned(quat, axis), 0]);
    return [...columns.flat(), ...pos, 1];
  };
  const looking = (eye, target) => {
    const back = unit(less(eye, target));
    const right = unit(cross([0, 0, 1], back));
    const up = cross(back, right);
    const rows = [right, up, back];
    return [
      ...[0, 1, 2].flatMap((k) => [...rows.map((row) => row[k]), 0]),
      ...rows.map((row) => -dot(row, eye)), 1];
  };
  const HALF_ANGLE = 0.3; // rad, of what is seen from top to bottom
  const perspective = (aspect, near, far) => {
    const f = 1 / Math.tan(HALF_ANGLE);
    return [
      f / aspect, 0, 0, 0, 0, f, 0, 0,
      0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
  };

  const VERTEX = `#version 300 es
    in vec3 place; uniform mat4 pose, camera; out vec3 at;
    void main() { vec4 p = pose * vec4(place, 1.0); at = p.xyz; gl_Position = camera * p; }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 at; uniform vec4 color; uniform vec3 eye; uniform bool lit; out vec4 seen;
    void main() {
      vec3 normal = normalize(cross(dFdx(at), dFdy(at)));
      float front = abs(dot(normal, normalize(eye - at)));
      float light = lit ? 0.5 + 0.4 * front + 0.2 * normal.z * sign(dot(normal, eye - at)) : 1.0;
      seen = vec4(color.rgb * light * color.a, color.a);
    }`;
  const compiled = (gl) => {
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "place");
    gl.linkProgram(program);
    return gl.getProgramParameter(program, gl.LINK_STATUS) ? program : null;
  };

  // Draws on a canvas; null where the browser has no WebGL.
  const robotView = (canvas) => {
    const gl = canvas.getContext("webgl2", {antialias: true, preserveDrawingBuffer: true});
    const program = gl && compiled(gl);
    if (!program) return null;
    gl.useProgram(program);
    gl.enableVertexAttribArray(0);
    const uniform = Object.fromEntries(["pose", "camera", "color", "eye", "lit"].map(
      (name) => [name, gl.getUniformLocation(program, name)]));
    const home = {azimuth: -1.0, elevation: 0.3, zoom: 1};
    const camera = {...home};
    let scene, motion, parts, follows, center, radius;

    const buffered = (points) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points.flat()), gl.STATIC_DRAW);
      return {buffer, count: points.length};
    };
    const built = () => scene.bodies.flatMap((_, body) => [true, false].flatMap((moves) => {
      const own = scene.geoms.filter(
        (geom) => geom.body === body && geom.moves === moves && geom.shape !== "plane");
      const points = own.flatMap((geom) => triangles(geom, scene.meshes).map(
        (p) => add(geom.pos, turned(geom.quat, p))));
      return points.length ? [{body, moves, ...buffered(points)}] : [];
    }));
    // The middle of what moves, and how far it reaches from there.
    const extent = (frame) => {
      const found = poses(scene, positions(scene, motion, "measured", frame, 1));
      if (!found) return null;
      const balls = scene.geoms.filter((geom) => geom.moves && geom.shape !== "plane").map((geom) => {
        const {pos, quat} = found[geom.body];
        return {at: add(pos, turned(quat, geom.pos)), bound: geom.bound};
      });
      if (!balls.length) return null;
      const middle = times(balls.reduce((sum, ball) => add(sum, ball.at), [0, 0, 0]), 1 / balls.length);
      return {middle, balls};
    };
    const reach = (middle, balls) => Math.max(
      ...balls.map(({at, bound}) => Math.hypot(...less(at, middle)) + bound));

    const choose = (newScene, newMotion) => {
      if (newScene !== scene) {
        parts?.forEach(({buffer}) => gl.deleteBuffer(buffer));
        scene = newScene;
        parts = null;
      }
      motion = newMotion;
      parts ??= built();
      follows = scene.bodies.some((body) => body.joints.some(
        (joint) => joint.type === "free" && motion.addresses.includes(joint.at)));
      const every = Math.max(1, Math.floor(motion.time.length / 30));
      const some = motion.time.map((_, k) => k).filter((k) => k % every === 0)
        .map(extent).filter((one) => one);
      const middles = some.map(({middle}) => middle);
      center = times(middles.reduce(add, [0, 0, 0]), 1 / (middles.length || 1));
      radius = Math.max(0.02, ...some.map(
        ({middle, balls}) => reach(follows ? middle : center, balls)));
    };

    const draw = (frame, {shown, factor}) => {
      const scale = Math.min(window.devicePixelRatio || 1, 2);
      const [width, height] = [canvas.clientWidth, canvas.clientHeight].map(
        (size) => Math.max(1, Math.round(size * scale)));
      if (canvas.width !== width || canvas.height !== height) {
        Object.assign(canvas, {width, height});
      }
      gl.viewport(0, 0, width, height);
      gl.clearColor(0, 0, 0, 0);
      gl.enable(gl.DEPTH_TEST);
      gl.depthFunc(gl.LEQUAL);
      gl.depthMask(true);
      gl.colorMask(true, true, true, true);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

      const target = (follows && extent(frame)?.middle) || center;
      const aspect = width / height;
      const far = 0.85 * radius / Math.sin(HALF_ANGLE) / Math.min(1, aspect) / camera.zoom;
      const [c, s] = [Math.cos(camera.elevation), Math.sin(camera.elevation)];
      const eye = add(target, times(
        [c * Math.cos(camera.azimuth), c * Math.sin(camera.azimuth), s], far));
      gl.uniformMatrix4fv(uniform.camera, false, multiplied(
        perspective(aspect, 0.02 * far, 20 * far), looking(eye, target)));
      gl.uniform3fv(uniform.eye, eye);

      const filled = (part, pose, color, alpha) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, part.buffer);
        gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
        gl.uniformMatrix4fv(uniform.pose, false, placed(pose));
        gl.uniform4f(uniform.color, ...color, alpha);
        gl.drawArrays(part.lines ? gl.LINES : gl.TRIANGLES, 0, part.count);
      };
      const resting = poses(scene, scene.qpos);
      grounds(target, resting, filled, shown.ground);
      gl.uniform1i(uniform.lit, 1);
      parts.filter((part) => !part.moves).forEach(
        (part) => filled(part, resting[part.body], shown.ground, 1));
      const lacking = [];
      shown.robots.forEach(({which, color, alpha, behind}) => {
        const found = poses(scene, positions(scene, motion, which, frame, factor));
        if (!found) {
          lacking.push(which);
          return;
        }
        const robot = parts.filter((part) => part.moves);
        const all = () => robot.forEach((part) => filled(part, found[part.body], color, alpha));
        gl.enable(gl.POLYGON_OFFSET_FILL);
        gl.polygonOffset(behind, 4 * behind); // where surfaces meet, which of them is seen
        if (alpha < 1) { // only the nearest surface of a ghost
          gl.colorMask(false, false, false, false);
          all();
          gl.colorMask(true, true, true, true);
        }
        all();
        gl.disable(gl.POLYGON_OFFSET_FILL);
      });
      return lacking;
    };
    const LINES = 12;
    const grounds = (target, resting, filled, color) => {
      gl.uniform1i(uniform.lit, 0);
      const decade = 10 ** Math.floor(Math.log10(radius));
      const step = decade * (radius > 4 * decade ? 2 : 0.5);
      for (const geom of scene.geoms.filter((one) => one.shape === "plane")) {
        const pose = resting[geom.body];
        const quat = product(pose.quat, geom.quat);
        const at = add(pose.pos, turned(pose.quat, geom.pos));
        const back = turned([quat[0], ...times(quat.slice(1), -1)], less(target, at));
        const [x, y] = back.map((value) => Math.round(value / step) * step);
        const points = [];
        for (let k = -LINES; k <= LINES; k++) {
          const [near, end] = [k * step, LINES * step];
          points.push([x + near, y - end, 0], [x + near, y + end, 0]);
          points.push([x - end, y + near, 0], [x + end, y + near, 0]);
        }
        const part = {...buffered(points), lines: true};
        filled(part, {pos: at, quat}, color, 0.35);
        gl.deleteBuffer(part.buffer);
      }
    };
    const moved = (changes) => {
      camera.azimuth += changes.azimuth ?? 0;
      camera.elevation = Math.min(1.5, Math.max(-1.5, camera.elevation + (changes.elevation ?? 0)));
      camera.zoom = Math.min(20, Math.max(0.2, camera.zoom * (changes.zoom ?? 1)));
    };
    return {choose, draw, moved, home: () => Object.assign(camera, home)};
  };
  return Object.assign(robotView, {poses, positions});
})();
