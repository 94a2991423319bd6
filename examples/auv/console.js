// Keys and STOP of the console. Keys in the capture phase: neither a slider nor a button that has the
// focus takes one first. Space stops wherever the focus is; while a field is written in, the other keys
// are its own. A press of STOP is not forgotten before the page's server says that it has taken it.
if (!window.auvStop) {
  const TAKEN_MS = 2000;
  const truth = window.zaTruth;
  let presses = 0, press = null;
  const isStopEvent = (event) => event.code === 'Space' ||
    (event.target instanceof Element && event.target.closest('.stop') !== null);
  window.auvStop = (give) => {
    press = { id: ++presses, at: performance.now(), isGiven: !truth.isGone() };
    if (press.isGiven) give(press.id);
  };
  truth.own(isStopEvent);
  truth.check((now, gone, taken) => {
    if (press && press.isGiven && taken >= press.id) press = null;
    if (!press) return [];
    const ago = `STOP pressed ${Math.round((now - press.at) / 1000)} s ago`;
    if (!press.isGiven) return [`${ago} was NOT SENT${gone ? '' : ': press it again'}`];
    return now - press.at > TAKEN_MS ? [`NOT SENT: ${ago}, the page server has not taken it`] : [];
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
    else if (!event.repeat) window.auvStop((id) => emitEvent('auv-stop', id));
  };
  window.addEventListener('keydown', take, true);
  window.addEventListener('keyup', take, true);
}
