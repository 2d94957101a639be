// node check.mjs: the golden steps of the shipped model in Node. Prints JSON; the exit status is 1 where y differs, 2 where a file is damaged.
import { readFile } from "node:fs/promises";
import * as ort from "onnxruntime-web/wasm";
import { check, checkGraph, readNpz } from "./step.mjs";

ort.env.wasm.numThreads = 1;
const assets = new URL("../../assets/", import.meta.url);
const file = async (path) => new Uint8Array(await readFile(new URL(path, assets))).buffer;
const model = async (name) => {
  const bytes = await file(`models/compact/${name}.onnx`);
  await checkGraph(await file("models/compact/metadata.json"), name, bytes);
  return bytes;
};
const graph = process.argv[2] ?? "step"; // or step_int8, whose y is rounded more
try {
  const golden = readNpz(await file("golden_step.npz"));
  const { worst, milliseconds } = await check(ort, await model("style"), await model(graph), golden);
  console.log(JSON.stringify({ graph, worst, milliseconds }));
  process.exit(worst < (graph === "step" ? 1e-4 : 0.1) ? 0 : 1);
} catch (error) {
  console.error(error.message);
  process.exit(2);
}
