// A press of STOP, kept until the page's server has it or a person dismisses it. It is kept in the
// browser's store, since the page reloads when the network comes back, and all pages of a browser have
// one: of several presses the newest counts. The server takes each id once, however often it is given.
globalThis.auvPress = ({ store, give, now }) => {
  const KEY = 'auv-stop', TAKEN_MS = 2000, AGAIN_MS = 1000;
  const OLD_MS = 600e3; // what is older is not sent by itself: the dive may be another one
  let copy = null, givenAt = -Infinity; // a browser may refuse its store
  const read = () => {
    try {
      const found = JSON.parse(store.getItem(KEY));
      return found && typeof found.id === 'string' && Number.isFinite(found.at) ? found : null;
    } catch { return copy; }
  };
  const write = (press) => {
    copy = press;
    try {
      if (press) store.setItem(KEY, JSON.stringify(press));
      else store.removeItem(KEY);
    } catch { /* the copy has to do */ }
  };
  const ageOf = (press) => Math.max(0, now() - press.at);
  const offer = (press) => {
    givenAt = now();
    give({ id: press.id, ago_ms: ageOf(press) });
  };
  return {
    press: (gone) => {
      const made = { id: `${now()}-${Math.random().toString(36).slice(2)}`, at: now() };
      write(made);
      if (!gone) offer(made);
    },
    dismiss: () => write(null),
    // Gives what is to be said of it, or null; `taken` has the ids that the server has.
    look: (gone, taken) => {
      const press = read();
      if (!press) return null;
      if (taken.has(press.id)) { write(null); return null; }
      const age = ageOf(press), isOld = age > OLD_MS;
      if (!gone && !isOld && Math.abs(now() - givenAt) >= AGAIN_MS) offer(press);
      if (!gone && age <= TAKEN_MS) return null;
      const why = isOld ? 'press it again'
        : gone ? 'kept until the page server is back' : 'the page server has not taken it';
      return { age, why };
    },
  };
};
