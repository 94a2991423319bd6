// Drives examples/auv/press.js with a clock and a store of its own; prints what it gave and said.
import { readFileSync } from 'node:fs';
const [source, steps] = [process.argv[2], JSON.parse(process.argv[3])];
eval(readFileSync(source, 'utf8'));
let now = 1.8e12, kept = new Map(), isRefused = false;
const refuse = () => { if (isRefused) throw new Error('refused'); };
const store = {
  getItem: (key) => { refuse(); return kept.get(key) ?? null; },
  setItem: (key, text) => { refuse(); kept.set(key, text); },
  removeItem: (key) => { refuse(); kept.delete(key); },
};
const names = new Map(), log = [];
const nameOf = (id) => names.get(id) ?? names.set(id, `press ${names.size + 1}`).get(id);
const page = (name) => globalThis.auvPress({ store, now: () => now,
  give: ({ id, ago_ms }) => log.push(`${name} gives ${nameOf(id)} of ${ago_ms / 1000} s ago`) });
const pages = { a: page('a'), b: page('b') };
const taken = new Set();
for (const [what, name, gone] of steps) {
  if (what === 'press') pages[name].press(gone);
  else if (what === 'wait') now += 1000 * name;
  else if (what === 'dismiss') pages[name].dismiss();
  else if (what === 'reload') pages[name] = page(name);
  else if (what === 'taken') for (const [id, each] of names) { if (each === name) taken.add(id); }
  else if (what === 'refuse') isRefused = true;
  else if (what === 'spoil') kept.set('auv-stop', name);
  else if (what === 'look') {
    const said = pages[name].look(gone, taken);
    log.push(said ? `${name} says ${said.age / 1000} s: ${said.why}` : `${name} says nothing`);
  }
}
console.log(JSON.stringify(log));
