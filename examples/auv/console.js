// Keys of the console. In the capture phase: neither a slider nor a button that has the focus takes a
// key first. Space stops wherever the focus is; while a field is written in, the other keys are its own.
if (!window.auvKeys) {
  window.auvKeys = true;
  const take = (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const isStop = event.code === 'Space';
    const isWriting = event.target instanceof Element && event.target.matches('input, textarea');
    const isOurs = isStop || event.key.startsWith('Arrow') || ['+', '-', '=', '0'].includes(event.key);
    if (!isOurs || (isWriting && !isStop)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.type === 'keydown' && !(isStop && event.repeat)) emitEvent('auv-key', event.key);
  };
  window.addEventListener('keydown', take, true);
  window.addEventListener('keyup', take, true);
}
