// Keys and STOP of the console. Keys in the capture phase: neither a slider nor a button that has the
// focus takes one first. Space stops wherever the focus is; while a field is written in, the other keys
// are its own. A press of STOP that the server has not taken stands in the banner and wherever the page
// tells of a STOP (class `press`), in the same words.
if (!window.auvStop) {
  const truth = window.zaTruth;
  const isStopEvent = (event) => event.code === 'Space' ||
    (event.target instanceof Element && event.target.closest('.stop') !== null);
  const stops = window.auvPress({
    store: { getItem: (key) => localStorage.getItem(key), setItem: (key, text) => localStorage.setItem(key, text),
      removeItem: (key) => localStorage.removeItem(key) },
    give: (press) => emitEvent('auv-stop', press),
    now: () => Date.now(),
  });
  window.auvStop = () => stops.press(truth.isGone());
  truth.own(isStopEvent);
  truth.check((now, gone, taken) => {
    const open = stops.look(gone, taken);
    const text = open ? `STOP pressed ${truth.long(open.age / 1000)} ago: NOT SENT, ${open.why}` : '';
    for (const each of document.querySelectorAll('.press')) {
      if (each.textContent !== text) each.textContent = text;
      each.hidden = !text;
    }
    return open ? [{ text, act: 'dismiss', run: stops.dismiss }] : [];
  });
  const take = (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const isStop = event.code === 'Space';
    const isWriting = event.target instanceof Element && event.target.matches('input, textarea');
    const isOurs = isStop || event.key.startsWith('Arrow') || ['+', '-', '=', '0'].includes(event.key);
    if (!isOurs || (isWriting && !isStop)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.type !== 'keydown') return;
    if (!isStop) emitEvent('auv-key', event.key);
    else if (!event.repeat) window.auvStop();
  };
  window.addEventListener('keydown', take, true);
  window.addEventListener('keyup', take, true);
}
