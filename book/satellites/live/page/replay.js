'use strict';
// The last recording as this page has shown it, for a replay while the live loop goes on.

const Replay = (() => {
  const MOST_BYTES = 96e6;  // of pictures; then every second instant is given up
  let tape = [], bytes = 0, taping = false;
  let at = null;  // s from the start; null: live
  let playing = false, before = 0, shown = -1;

  const length = () => tape.length > 1 ? (tape[tape.length - 1].ms - tape[0].ms) / 1000 : 0;
  const ready = () => !taping && length() > 0;
  const on = () => at !== null;

  function keep(now, jpegs) {
    if (now.recording && !taping) {
      leave();
      tape = [];
      bytes = 0;
    }
    const ends = taping && !now.recording;
    taping = now.recording;
    if (taping) {
      tape.push({ms: performance.now(), now, jpegs});
      bytes += jpegs.reduce((sum, one) => sum + one.size, 0);
      if (bytes > MOST_BYTES) {
        tape = tape.filter((_, k) => k % 2 === 0);
        bytes /= 2;
      }
    }
    if (ends || taping) tell();
    if (ends) band();
  }

  // The frames of the tape up to the one that is shown, no older than so many ms.
  function past(ms) {
    const last = tape[shown];
    return tape.slice(0, shown + 1).filter(one => last.ms - one.ms < ms);
  }

  function index() {
    const ms = tape[0].ms + 1000 * at;
    let k = tape.findIndex(one => one.ms > ms);
    if (k < 0) k = tape.length;
    return Math.max(k - 1, 0);
  }

  function go(to) {
    if (!ready()) return;
    if (!on()) document.dispatchEvent(new CustomEvent('replay'));
    at = Math.min(Math.max(to, 0), length());
    const k = index();
    if (k !== shown) show(k);
    tell();
  }

  async function show(k) {
    shown = k;
    const {now, jpegs} = tape[k];
    const pictures = await Promise.all(jpegs.map(one => createImageBitmap(one)));
    if (on() && shown === k) document.dispatchEvent(new CustomEvent('replayed', {detail: {now, pictures}}));
    else pictures.forEach(one => one.close());
  }

  function step(ms) {
    if (!playing) return;
    const to = at + (ms - before) / 1000;
    before = ms;
    go(to);
    if (to >= length()) pause();
    else requestAnimationFrame(step);
  }

  function play() {
    if (!ready()) return;
    go(on() && at < length() ? at : 0);
    playing = true;
    before = performance.now();
    requestAnimationFrame(step);
    tell();
  }

  function pause() {
    playing = false;
    tell();
  }

  function leave() {
    if (!on()) return;
    at = null;
    shown = -1;
    playing = false;
    tell();
    document.dispatchEvent(new CustomEvent('live'));
  }

  function tell() {
    const why = taping ? 'Grey: a recording grows. Stop it, and it can be replayed.'
      : ready() ? '' : 'Grey: nothing is recorded yet. Press Record, and then Stop recording.';
    for (const id of ['play', 'scrub']) grey($(id), why);
    $('back').hidden = !on();
    $('play').textContent = playing ? 'Pause' : 'Play';
    $('play').setAttribute('aria-pressed', playing);
    $('scrub').max = (0.05 * Math.ceil(20 * length())).toFixed(2);
    if (document.activeElement !== $('scrub') || !on() || playing) $('scrub').value = on() ? at : 0;
    const of = `${length().toFixed(1)} s`;
    $('when').value = on() ? `${at.toFixed(1)} s of ${of}` : taping ? `${of} so far` : ready() ? of : '';
    $('scrub').setAttribute('aria-valuetext', on() ? `${$('when').value}, ${tape[shown].now.status}` : $('when').value || 'nothing recorded');
    document.querySelector('main').classList.toggle('replaying', on());
    $('replaying').hidden = !on();
  }

  // The tape as a band: the pose's status, and below it where the clutch was closed.
  function band() {
    const canvas = $('band'), ratio = devicePixelRatio || 1;
    [canvas.width, canvas.height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    const pen = canvas.getContext('2d');
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (!length()) return;
    const u = ms => canvas.width * (ms - tape[0].ms) / 1000 / length();
    tape.slice(0, -1).forEach((one, k) => {
      const [from, to] = [u(one.ms), u(tape[k + 1].ms)];
      pen.fillStyle = colour({measured: 'good', lost: 'bad'}[one.now.status] || 'warn');
      pen.fillRect(from, 0, to - from + 1, 0.55 * canvas.height);
      pen.fillStyle = colour(one.now.held ? 'bad' : one.now.clutch ? 'accent' : 'grid');
      pen.fillRect(from, 0.65 * canvas.height, to - from + 1, 0.35 * canvas.height);
    });
  }

  return {keep, on, past, play, pause, go, leave, tell, band, playing: () => playing, size: () => ({count: tape.length, bytes}), frame: () => tape[shown] && tape[shown].now};
})();

$('play').onclick = () => Replay.playing() ? Replay.pause() : Replay.play();
$('scrub').oninput = event => { Replay.pause(); Replay.go(Number(event.target.value)); };
$('back').onclick = Replay.leave;
