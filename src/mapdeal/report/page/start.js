"use strict";

const report = JSON.parse(document.getElementById("report").textContent);
const { abs, cos, floor, hypot, max, min, round, sin } = Math;
