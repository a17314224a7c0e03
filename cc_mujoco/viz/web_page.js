// Plays an episode: one time for the scene, the plots, the slider and the clock.
"use strict";
const KINDS = { f4: Float32Array, i4: Int32Array };
const MARGIN = { l: 46, r: 12, t: 6, b: 22 };

// An array as `packed` wrote it; little-endian, as every machine with a browser is.
function unpack(field) {
  const bytes = Uint8Array.from(atob(field.bdata), (c) => c.charCodeAt(0));
  return new KINDS[field.dtype](bytes.buffer);
}

function at(list, value) { // last place whose entry is not above the value
  let low = 0, high = list.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (list[middle] <= value) low = middle; else high = middle - 1;
  }
  return low;
}

function nearest(list, value) {
  const i = at(list, value);
  return i + 1 < list.length && list[i + 1] - value < value - list[i] ? i + 1 : i;
}

function coordinates(points, start, count) { // x, y and z apart
  return [0, 1, 2].map((axis) =>
    Float32Array.from({ length: count }, (_, i) => points[start + 3 * i + axis]));
}

function Scene(div, data, frames) {
  const poses = unpack(data.scene.poses), bodies = data.scene.poses.shape[1];
  const meshes = data.scene.meshes.map((mesh) => {
    const vertices = unpack(mesh.vertices), corners = unpack(mesh.triangles);
    const [i, j, k] = coordinates(corners, 0, corners.length / 3);
    return { ...mesh, vertices, i, j, k };
  });
  const lines = data.scene.lines.map((line) => ({
    ...line, points: unpack(line.points), count: line.points.shape[1],
    moves: line.points.shape[0] > 1,
    tension: line.tension && unpack(line.tension), nodes: line.nodes && unpack(line.nodes),
    width_: line.tension && line.tension.shape[1],
  }));

  function place(mesh, frame) {
    const count = mesh.vertices.length / 3;
    if (mesh.body < 0) return coordinates(mesh.vertices, 0, count);
    const m = poses.subarray(12 * (frame * bodies + mesh.body)), v = mesh.vertices;
    return [0, 1, 2].map((row) => Float32Array.from({ length: count }, (_, n) =>
      m[4 * row] * v[3 * n] + m[4 * row + 1] * v[3 * n + 1] + m[4 * row + 2] * v[3 * n + 2]
      + m[4 * row + 3]));
  }

  function tensions(line, frame) { // between the two nodes beside each point
    const row = line.tension.subarray(frame * line.width_, (frame + 1) * line.width_);
    return Array.from(line.nodes, (node) => {
      const low = Math.min(Math.floor(node), line.width_ - 2), share = node - low;
      return (1 - share) * row[low] + share * row[low + 1];
    });
  }

  const start = (line, frame) => (line.moves ? 3 * frame * line.count : 0);
  const traces = [
    ...meshes.map((mesh) => {
      const [x, y, z] = place(mesh, 0);
      return {
        type: "mesh3d", x, y, z, i: mesh.i, j: mesh.j, k: mesh.k, color: mesh.color,
        opacity: mesh.opacity, hoverinfo: "skip", flatshading: false,
        // Triangles of a millimetre have areas that are 0 to the library otherwise.
        lighting: { ambient: 0.6, diffuse: 0.6, specular: 0.08, roughness: 0.6,
          fresnel: 0, facenormalsepsilon: 0, vertexnormalsepsilon: 0 },
        lightposition: { x: -2000, y: -4000, z: 8000 },
      };
    }),
    ...lines.map((line) => {
      const [x, y, z] = coordinates(line.points, 0, line.count);
      const look = line.tension
        ? { color: tensions(line, 0), colorscale: data.colors, cmin: 0,
          cmax: data.highest, width: line.width }
        : { color: line.color, width: line.width };
      return { type: "scatter3d", mode: "lines", x, y, z, line: look, name: line.name,
        hoverinfo: line.name ? "name" : "skip" };
    }),
  ];
  const { box, camera } = data.scene, sides = box.map(([low, high]) => high - low);
  const scale = Math.cbrt(sides[0] * sides[1] * sides[2]);
  const axis = (n) => ({ visible: false, range: box[n], autorange: false,
    showspikes: false });
  const layout = {
    margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, paper_bgcolor: "rgba(0,0,0,0)",
    scene: {
      xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual",
      aspectratio: { x: sides[0] / scale, y: sides[1] / scale, z: sides[2] / scale },
      camera, dragmode: "turntable", bgcolor: "rgba(0,0,0,0)",
    },
  };
  const made = Plotly.newPlot(div, traces, layout, { responsive: true,
    displaylogo: false, displayModeBar: false, scrollZoom: true });

  let shown = 0, wanted = 0, busy = true;
  made.then(() => { busy = false; draw(); });
  function draw() {
    if (busy || wanted === shown) return;
    busy = true;
    shown = wanted;
    const change = { x: [], y: [], z: [], "line.color": [] }, which = [];
    const add = (index, xyz, color) => {
      change.x.push(xyz ? xyz[0] : undefined);
      change.y.push(xyz ? xyz[1] : undefined);
      change.z.push(xyz ? xyz[2] : undefined);
      change["line.color"].push(color);
      which.push(index);
    };
    meshes.forEach((mesh, n) => { if (mesh.body >= 0) add(n, place(mesh, shown)); });
    lines.forEach((line, n) => {
      if (!line.moves && !line.tension) return;
      add(meshes.length + n,
        line.moves && coordinates(line.points, start(line, shown), line.count),
        line.tension && tensions(line, shown));
    });
    Plotly.restyle(div, change, which).then(() => { busy = false; draw(); });
  }
  return { made, show: (time) => { wanted = nearest(frames, time); draw(); } };
}

function Plots(sections, data, time, goTo) {
  const end = time[time.length - 1];
  const divs = sections.map((section) => section.querySelector(".plot"));
  const cursors = sections.map((section) => section.querySelector(".cursor"));
  const lines = data.panels.map((panel) => panel.lines.map((line) => unpack(line.values)));
  const mouse = matchMedia("(pointer: fine)").matches;
  const colors = () => {
    const style = getComputedStyle(document.body);
    return { text: style.color, line: style.getPropertyValue("--line").trim() };
  };
  let view = [time[0], end], now = time[0];

  const axes = () => {
    const { text, line } = colors();
    const axis = { gridcolor: line, zerolinecolor: text, zerolinewidth: 0.6, color: text };
    return { axis, font: { color: text, size: 11, family: getComputedStyle(document.body).fontFamily } };
  };
  const made = divs.map((div, n) => {
    const panel = data.panels[n], { axis, font } = axes();
    const traces = panel.lines.map((line, k) => ({
      x: time, y: lines[n][k], type: "scatter", mode: "lines", hoverinfo: "none",
      line: { color: line.color, width: 1.3, dash: line.dashed ? "5px,3px" : "solid" },
    }));
    const layout = {
      margin: { ...MARGIN, autoexpand: false }, showlegend: false, font,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      dragmode: mouse ? "zoom" : false, hovermode: "x",
      xaxis: { ...axis, range: view, zeroline: false, ticksuffix: " s", nticks: 8 },
      yaxis: { ...axis, fixedrange: true, nticks: 5, hoverformat: ".4g",
        ...(panel.range ? { range: panel.range } : {}) },
    };
    return Plotly.newPlot(div, traces, layout, { responsive: true, displayModeBar: false });
  });

  function mark() {
    cursors.forEach((cursor, n) => {
      const wide = divs[n].clientWidth - MARGIN.l - MARGIN.r;
      const share = (now - view[0]) / (view[1] - view[0]);
      cursor.style.left = `${MARGIN.l + share * wide}px`;
      cursor.hidden = share < 0 || share > 1;
    });
  }
  function zoom(range) { // all plots show the same part
    if (range[0] === view[0] && range[1] === view[1]) return;
    view = range;
    divs.forEach((div) => Plotly.relayout(div, { "xaxis.range": [...range] }));
    mark();
  }
  Promise.all(made).then(() => divs.forEach((div) => {
    div.on("plotly_relayout", (change) => {
      if (change["xaxis.autorange"]) zoom([time[0], end]);
      else if ("xaxis.range[0]" in change) {
        zoom([change["xaxis.range[0]"], change["xaxis.range[1]"]].map(Number));
      }
    });
    div.on("plotly_click", (event) => goTo(event.points[0].x));
  }));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    const { axis, font } = axes();
    divs.forEach((div) => Plotly.relayout(div, {
      font, "xaxis.gridcolor": axis.gridcolor, "xaxis.color": axis.color,
      "yaxis.gridcolor": axis.gridcolor, "yaxis.color": axis.color,
      "yaxis.zerolinecolor": axis.zerolinecolor,
    }));
  });
  addEventListener("resize", mark);

  const values = sections.map((section) => section.querySelectorAll(".key b"));
  const decimals = lines.map((panel) => { // three digits of the largest
    const most = panel.reduce((top, line) =>
      line.reduce((high, value) => Math.max(high, Math.abs(value)), top), 0);
    return Math.min(Math.max(2 - Math.floor(Math.log10(most || 1)), 0), 6);
  });
  return {
    made: Promise.all(made),
    show(time_) {
      now = time_;
      const i = nearest(time, now);
      values.forEach((row, n) => row.forEach((cell, k) => {
        cell.textContent = lines[n][k][i].toFixed(decimals[n]);
      }));
      mark();
    },
  };
}

function main() {
  const data = JSON.parse(document.getElementById("episode").textContent);
  const time = unpack(data.time), frames = unpack(data.frames);
  const start = time[0], end = time[time.length - 1];
  const [button, slider, clock, speed] =
    ["play", "moment", "clock", "speed"].map((id) => document.getElementById(id));
  slider.min = start;
  slider.max = end;
  let now = start, before = null;

  const scene = Scene(document.getElementById("scene"), data, frames);
  const sections = [...document.querySelectorAll(".plots section")];
  const plots = Plots(sections, data, time, goTo);

  function goTo(moment) {
    now = Math.min(Math.max(moment, start), end);
    slider.value = now;
    clock.textContent = `${now.toFixed(2)} s`;
    scene.show(now);
    plots.show(now);
  }
  function step(stamp) {
    if (before === null) return;
    const passed = (stamp - before) / 1000 * Number(speed.value);
    before = stamp;
    goTo(now + Math.max(passed, 0));
    if (now < end) requestAnimationFrame(step); else pause();
  }
  function pause() {
    before = null;
    button.textContent = "▶";
    button.setAttribute("aria-label", "play");
  }
  function play() {
    if (now >= end) goTo(start);
    before = performance.now();
    button.textContent = "❚❚";
    button.setAttribute("aria-label", "pause");
    requestAnimationFrame(step);
  }
  const toggle = () => (before === null ? play() : pause());
  button.addEventListener("click", toggle);
  slider.addEventListener("input", () => { pause(); goTo(Number(slider.value)); });
  addEventListener("keydown", (event) => {
    if (event.key === " " && event.target === document.body) {
      event.preventDefault();
      toggle();
    }
  });
  // A moment can be linked to: episode.html#t=1.2
  const linked = () => {
    const found = /^#t=(\d+(\.\d*)?)$/.exec(location.hash);
    if (found) goTo(Number(found[1]));
  };
  addEventListener("hashchange", linked);
  goTo(start);
  linked();
  Promise.all([scene.made, plots.made]).then(() => {
    document.body.dataset.ready = "yes";
  });
}

function fail(reason) {
  const line = document.getElementById("wrong");
  line.textContent = `This page could not be shown: ${reason}.`;
  line.style.display = "block";
}
addEventListener("unhandledrejection", (event) => fail(event.reason));
try { main(); } catch (error) { fail(error); throw error; }
