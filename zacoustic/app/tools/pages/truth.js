// What a page can only know by itself: that its server is gone, and how old what it shows has become.
// The server beats (an element whose number changes); silence of LIMIT_MS is said in a banner over
// the whole width, what is shown turns grey, and whatever would have to be sent is not taken any more.
// Ages count by the clock of the browser. The server's own alarms stand in the same banner.
if (!window.zaTruth) {
  const LIMIT_MS = 2200, TICK_MS = 200;
  const ages = new WeakMap();
  const checks = [], owners = [];
  let number = null, at = performance.now(), gone = false;
  const banner = document.createElement('div');
  banner.id = 'za-banner';
  banner.setAttribute('role', 'alert');
  banner.hidden = true;

  const digits = (value, places) => value.toFixed(places);
  const two = (value) => String(value).padStart(2, '0');
  // As `ago` of the console says it, and `time_words` of the dashboard.
  const forms = {
    long: (s) => { const w = Math.max(0, Math.round(s));
      if (w < 60) return `${w} s`;
      if (w < 3600) return `${Math.floor(w / 60)} min ${two(w % 60)} s`;
      return `${Math.floor(w / 3600)} h ${two(Math.floor((w % 3600) / 60))} min`; },
    short: (s) => s < 10 ? `${digits(s, 1)} s` : s < 120 ? `${digits(s, 0)} s`
      : s < 7200 ? `${digits(s / 60, 0)} min` : s < 172800 ? `${digits(s / 3600, 1)} h` : `${digits(s / 86400, 1)} d`,
  };
  const count = (now) => {
    for (const each of document.querySelectorAll('[data-age]')) {
      let known = ages.get(each);
      if (!known || known.said !== each.dataset.age) ages.set(each, known = { said: each.dataset.age, at: now });
      const text = forms[each.dataset.form || 'long'](Number(known.said) + (now - known.at) / 1000);
      if (each.textContent !== text) each.textContent = text;
    }
  };
  const said = document.createElement('span'), buttons = new Map();
  banner.append(said);
  // A button stays the same element while its line counts on: else no click would hit it.
  const show = (lines) => {
    const text = lines.map((line) => line.text).join('\n');
    if (said.textContent !== text) said.textContent = text;
    const acts = new Map(lines.filter((line) => line.act).map((line) => [line.act, line.run]));
    for (const [name, button] of buttons) if (!acts.has(name)) { button.remove(); buttons.delete(name); }
    for (const [name, run] of acts) {
      if (!buttons.has(name)) {
        const button = document.createElement('button');
        button.textContent = name;
        banner.append(button);
        buttons.set(name, button);
      }
      buttons.get(name).onclick = () => { run(); look(); };
    }
    banner.hidden = !text;
    if (!banner.isConnected) document.body.prepend(banner);
    document.documentElement.style.setProperty('--za-banner', `${banner.offsetHeight}px`);
  };
  const look = () => {
    const now = performance.now();
    const beat = document.getElementById('za-beat');
    if (beat && beat.dataset.beat !== number) {
      number = beat.dataset.beat;
      at = now;
      emitEvent('za-echo', Number(number)); // so the server knows how old what comes behind it is
    }
    gone = now - at > LIMIT_MS;
    document.body.classList.toggle('za-gone', gone);
    const lines = [];
    const what = beat && beat.dataset.what || 'NOT SENT';
    if (gone) lines.push(`${what}: page server gone since ${forms.long((now - at) / 1000)}`);
    else if (beat && beat.dataset.dead) {
      const since = beat.dataset.since;
      const passed = since === '' ? '' : ` since ${forms.long(Number(since) + (now - at) / 1000)}`;
      lines.push(`${beat.dataset.dead}${passed}`);
    }
    const taken = new Set((beat && beat.dataset.taken || '').split(' '));
    for (const check of checks) lines.push(...check(now, gone, taken));
    show(lines.map((line) => typeof line === 'string' ? { text: line } : line));
    count(now);
  };
  // While nobody would take it, nothing is pressed: it would be sent when the server comes back.
  const refuse = (event) => {
    if (!gone || !(event.target instanceof Element)) return;
    if (event.type.startsWith('key') && event.key === 'Tab') return;
    if (banner.contains(event.target) || owners.some((isOwn) => isOwn(event))) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  };
  for (const kind of ['click', 'pointerdown', 'mousedown', 'touchstart', 'keydown', 'keyup', 'beforeinput'])
    window.addEventListener(kind, refuse, { capture: true, passive: false });
  // `check` gives lines of the banner, a text or `{text, act, run}` with a button; `own` tells whose
  // events pass also while the server is gone.
  window.zaTruth = { isGone: () => gone, check: (take) => checks.push(take),
    own: (isOwn) => owners.push(isOwn), long: forms.long };
  setInterval(look, TICK_MS);
  document.addEventListener('visibilitychange', look); // timers sleep in a window that nobody sees
}
