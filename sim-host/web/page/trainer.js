// Trains in a worker, so that the page flies on. Hears { begin: { task, seed } } and { stop: true }.
import init, { WebTraining } from "./pkg/kestrel_web.js";

/** How long it computes before it listens and tells [ms]. */
const TURN_MS = 60;

const ready = init();
let stopped = false;

self.onmessage = async ({ data }) => {
  if (data.stop) {
    stopped = true;
    return;
  }
  try {
    await ready;
    await train(data.begin.task, data.begin.seed);
  } catch (error) {
    self.postMessage({ error: String(error.message ?? error) });
  }
};

async function train(task, seed) {
  const training = new WebTraining(task, seed);
  const begun = performance.now();
  stopped = false;
  while (!training.is_finished && !stopped) {
    const turn = performance.now();
    let update;
    do {
      update?.free();
      update = training.update();
    } while (!training.is_finished && performance.now() - turn < TURN_MS);
    const { steps, total_steps: total, success_rate: success } = update;
    update.free();
    self.postMessage({ progress: { steps, total, success, secs: (performance.now() - begun) / 1000 } });
    await new Promise((resolve) => setTimeout(resolve)); // a word to stop is heard here
  }
  const secs = (performance.now() - begun) / 1000;
  const policy = training.policy();
  const success = training.judge(policy);
  training.free();
  self.postMessage({ finished: { policy, success, secs, stopped } }, [policy.buffer]);
}
