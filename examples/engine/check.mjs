// node check.mjs: the golden steps of the shipped model in Node. Prints JSON; the exit status is 1 where y differs.
import { readFile } from "node:fs/promises";
import * as ort from "onnxruntime-web/wasm";
import { check, readNpz } from "./step.mjs";

ort.env.wasm.numThreads = 1;
const file = async (path) => new Uint8Array(await readFile(new URL(`../../assets/${path}`, import.meta.url))).buffer;
const golden = readNpz(await file("golden_step.npz"));
const graph = process.argv[2] ?? "step"; // or step_int8, whose y is rounded more
const { worst, milliseconds } = await check(ort, await file("models/compact/style.onnx"), await file(`models/compact/${graph}.onnx`), golden);
console.log(JSON.stringify({ graph, worst, milliseconds }));
process.exit(worst < (graph === "step" ? 1e-4 : 0.1) ? 0 : 1);
