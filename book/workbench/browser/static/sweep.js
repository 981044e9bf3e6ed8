// A sweep of the chapter on its page: a run a value, two at once in workers of their own. Finished
// runs are kept in this browser, so that a sweep that was stopped, or whose page was left, goes on.
import { button, element, save, status } from './elements.js';
import { runs } from './runs.js';
import { Runtime } from './runtime.js';

const CHAPTER = location.pathname.split('/').at(-1).replace('.html', '');
const WORKERS = 2;
const SWEEPING = name => `__import__('workbench.browser.guest.sweeping', fromlist=['${name}']).${name}`;

/** Numbers from what was typed; throws an Error that says what is wrong. */
function numbers(text) {
    const values = text.split(/[\s,;]+/).filter(part => part !== '').map(Number);
    if (values.length === 0) throw new Error('type at least one value');
    if (values.some(value => !Number.isFinite(value))) throw new Error('type numbers, with commas between them');
    return [...new Set(values)].sort((a, b) => a - b);
}

class Sweep {
    constructor() {
        Object.assign(this, JSON.parse(document.getElementById('browser-sweep-data').textContent));
        this.workers = [];
        this.running = false;
        this.looks = 0;
        this.input = element('input', { type: 'text', id: 'browser-sweep-values', value: this.values.join(', '), className: 'browser-values' });
        this.input.addEventListener('input', () => this.look());
        this.startButton = button('Start', () => this.start());
        this.stopButton = button('Stop', () => this.stop());
        this.stopButton.disabled = true;
        this.forgetButton = button('Forget its runs', () => this.forget());
        this.share = element('progress', { max: 1, value: 0, hidden: true });
        this.share.setAttribute('aria-label', 'Runs that are done');
        this.said = status('browser-said');
        this.figure = element('div', { className: 'browser-figure' });
        this.table = element('div', { className: 'browser-table', tabIndex: 0 });
        this.table.setAttribute('role', 'region');
        this.table.setAttribute('aria-label', 'Table of the runs');
        this.saveButton = button('Save table.csv', () => save('table.csv', this.drawn.csv, 'text/csv'));
        this.saveButton.hidden = true;
        const place = element('section', { className: 'browser-sweep', id: 'browser-sweep' },
            element('h2', { textContent: `Sweep ${this.parameter} in this browser` }),
            element('p', { textContent: `The chapter runs once at each value, ${WORKERS} values at a time; what no value reaches runs once. `
                + 'Finished runs are kept in this browser: a sweep that was stopped goes on where it was.' }),
            element('label', { htmlFor: 'browser-sweep-values', textContent: `Values of ${this.parameter} (${this.called})` }), this.input,
            element('div', { className: 'browser-tools' }, this.startButton, this.stopButton, this.forgetButton, this.share, this.said),
            this.figure, this.table, this.saveButton);
        document.querySelector('article.bd-article').append(place);
        document.querySelector('.browser-bar')?.append(element('a', { href: '#browser-sweep', textContent: 'Sweep' }));
        this.look();
    }

    say(text) {
        this.said.textContent = text;
    }

    key(what) {
        return `${this.made_from}/${what}`;
    }

    /** What is kept of the values that are typed. */
    async look() {
        this.looks += 1;
        const look = this.looks;
        try {
            const values = numbers(this.input.value);
            const known = await Promise.all(values.map(value => runs.get(this.key(value))));
            const drawn = await runs.get(this.key(`figure/${values}`));
            if (look !== this.looks) return; // meanwhile other values were typed
            this.valid = true;
            const all = values.map((value, k) => ({ value, outcome: known[k] }));
            this.rows = all.filter(({ outcome }) => outcome);
            this.todo = all.filter(({ outcome }) => !outcome).map(({ value }) => value);
            this.total = values.length;
            this.drawn = drawn;
            this.startButton.textContent = this.rows.length === 0 || this.todo.length === 0 ? 'Start' : 'Continue';
            this.startButton.disabled = this.running;
            const done = `${this.rows.length} of ${this.total} runs are kept in this browser`;
            this.say(this.rows.length > 0 ? done : `${this.total} runs`);
            if (this.drawn && this.todo.length === 0) this.showDrawn();
            else this.showRows();
        } catch (error) {
            this.valid = false;
            this.startButton.disabled = true;
            this.say(error.message);
        }
    }

    showRows() {
        this.figure.replaceChildren();
        this.saveButton.hidden = true;
        const cells = (tag, texts) => element('tr', {}, ...texts.map(text => element(tag, { textContent: text })));
        const rows = this.rows.toSorted((a, b) => a.value - b.value)
            .map(({ value, outcome }) => cells('td', [value, outcome.status, outcome.seconds.toFixed(1), outcome.error]));
        this.table.replaceChildren(...rows.length === 0 ? [] : [element('table', {}, cells('th', [this.parameter, 'status', 'seconds', 'error']), ...rows)]);
    }

    showDrawn() {
        this.figure.replaceChildren(element('img', { src: `data:image/png;base64,${this.drawn.png}`, alt: this.drawn.alt, className: 'browser-image' }));
        this.table.innerHTML = this.drawn.table;
        this.saveButton.hidden = false;
    }

    progress(loaded) {
        if (loaded < 1) this.say(`loading the runtime: ${Math.round(100 * loaded)} %`);
    }

    async start() {
        if (this.running) return;
        this.running = true;
        await this.look();
        this.running = this.valid;
        if (!this.running) return;
        const values = numbers(this.input.value);
        this.startButton.disabled = this.input.disabled = this.forgetButton.disabled = true;
        this.stopButton.disabled = this.share.hidden = false;
        this.share.value = this.rows.length / this.total;
        this.figure.replaceChildren();
        this.begun = performance.now();
        this.before = this.rows.length;
        this.say('starting Python');
        try {
            const first = this.added({ onprogress: share => this.progress(share) });
            await first.start();
            const count = Math.max(1, Math.min(WORKERS, this.todo.length));
            const others = Array.from({ length: count - 1 }, () => this.added());
            await Promise.all([first, ...others].map(worker => this.work(worker)));
            const failed = this.rows.filter(({ outcome }) => outcome.status === 'failed').length;
            if (failed < this.total) await this.draw(first, values);
            this.say(failed === 0 ? `all ${this.total} runs are done` : `${failed} of ${this.total} runs failed`);
        } catch (error) {
            const whole = this.rows.filter(({ outcome }) => outcome.status !== 'failed').length;
            this.say(`${this.stopped ?? error.message}: ${whole} of ${this.total} runs are kept`);
        } finally {
            this.stopped = null;
            this.running = false;
            this.workers.splice(0).forEach(worker => worker.interrupt());
            this.input.disabled = this.forgetButton.disabled = this.startButton.disabled = false;
            this.stopButton.disabled = this.share.hidden = true;
            this.startButton.textContent = this.todo.length > 0 || this.rows.length < this.total ? 'Continue' : 'Start';
        }
    }

    added(about = {}) {
        const worker = new Runtime(about);
        this.workers.push(worker);
        return worker;
    }

    /** One worker: take the next value until there is none. */
    async work(worker) {
        if (this.todo.length === 0) return;
        await worker.start();
        const part = await fetch(new URL(`../sweeps/${CHAPTER}.json`, import.meta.url));
        await worker.write('tmp/sweep.json', await part.arrayBuffer());
        this.sayLeft();
        await this.asked(worker, 'prepare');
        while (this.todo.length > 0) {
            const value = this.todo.shift();
            const outcome = await this.asked(worker, 'run', value);
            if (outcome.status !== 'failed') await runs.put(this.key(value), outcome); // a failed one is tried again
            this.rows.push({ value, outcome });
            this.showRows();
            this.sayLeft();
        }
    }

    sayLeft() {
        const [done, left] = [this.rows.length - this.before, this.total - this.rows.length];
        const minutes = Math.ceil((performance.now() - this.begun) / 60_000 / done * left);
        this.share.value = this.rows.length / this.total;
        const rest = done === 0 || left === 0 ? '' : `; about ${minutes} ${minutes === 1 ? 'minute' : 'minutes'} left`;
        this.say(`${this.rows.length} of ${this.total} runs are done${rest}`);
    }

    /** What a function of the worker hands out. */
    async asked(worker, name, ...given) {
        if (!this.workers.includes(worker)) throw new Error('stopped'); // it would begin a new session
        let result = null;
        const onoutput = output => {
            if (output.type === 'run' || output.type === 'sweep') result = output;
        };
        const source = `${SWEEPING(name)}(${given.map(one => JSON.stringify(one)).join()})`;
        const { error } = await worker.run(source, { name: 'sweep', onoutput });
        if (error) throw new Error(error.cannot ?? error.text.trim().split('\n').at(-1));
        return result;
    }

    async draw(worker, values) {
        this.say('drawing');
        const rows = this.rows.toSorted((a, b) => a.value - b.value);
        const text = JSON.stringify({ parameter: this.parameter, rows });
        await worker.write('tmp/rows.json', new TextEncoder().encode(text).buffer);
        this.drawn = await this.asked(worker, 'draw');
        if (rows.every(({ outcome }) => outcome.status !== 'failed')) await runs.put(this.key(`figure/${values}`), this.drawn);
        this.showDrawn();
    }

    /** End the workers, now; what they were computing is lost, and finished runs are not. */
    stop() {
        this.stopped = 'stopped';
        this.workers.splice(0).forEach(worker => worker.interrupt());
    }

    async forget() {
        await runs.forget(`${this.made_from}/`);
        await this.look();
    }
}

window.sweep = new Sweep();
