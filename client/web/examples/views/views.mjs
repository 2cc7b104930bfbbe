// Draws the views of `main.rs` with the program of the page. Prints the milliseconds of each.

import { readFileSync } from "node:fs";
import { join } from "node:path";

const [folder, world, said, ...numbers] = process.argv.slice(2);
const [columns, rows, views, repeats] = numbers.map(Number);
// Node takes a file for a module by its name alone.
const script = readFileSync(join(folder, "sightline_web.js"), "base64");
const page = await import(`data:text/javascript;base64,${script}`);
page.initSync({ module: readFileSync(join(folder, "sightline_web_bg.wasm")) });

const bytes = readFileSync(said);
const end = 4 + bytes.readUInt32LE(0);
const client = new page.Client("Ada", 0, new Uint8Array(32), "");
client.opened(0);
client.control(1, bytes.subarray(4, end));
client.give_world(readFileSync(world));
client.control(2, bytes.subarray(end));

let now = 3;
for (let view = 0; view < views; view++) {
  client.turn((2 * Math.PI) / views, 0);
  let least = Infinity;
  for (let i = 0; i < repeats; i++) {
    client.draw(now, 16, 9);
    now += 1;
    client.step(now, 0, 0, 0, false, false);
    const start = process.cpuUsage();
    client.draw(now, columns, rows);
    const { user, system } = process.cpuUsage(start);
    least = Math.min(least, (user + system) / 1000);
  }
  console.log(least);
}
