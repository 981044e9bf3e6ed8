// Answers to a chapter's exercises on its page: a place to write at each, checked by the graders of
// the notebook in a worker of its own, kept in this browser, and saved as a notebook.
import { Editor } from './editor.js';
import { button, element, save, status } from './elements.js';
import { show } from './outputs.js';
import { Runtime } from './runtime.js';

const CHAPTER = location.pathname.split('/').at(-1).replace('.html', '');
const GRADE = "__import__('workbench.browser.guest.answers', fromlist=['grade']).grade";
const PREDICTIONS = 'book/notebooks/predictions.json'; // where the graders keep first guesses
const LIMIT_S = 60; // an answer that takes longer does not end

/** What is kept in this browser, by name; where it keeps nothing, that is said once. */
const kept = {
    read(name) {
        try {
            return JSON.parse(localStorage.getItem(`trinolab/${name}`) ?? 'null');
        } catch {
            return null;
        }
    },
    write(name, value) {
        try {
            localStorage.setItem(`trinolab/${name}`, JSON.stringify(value));
            return true;
        } catch {
            return false;
        }
    },
    remove: name => localStorage.removeItem(`trinolab/${name}`),
};

/** The answer to one exercise. */
class Answer {
    constructor(about, exercises) {
        Object.assign(this, about, { stub: about.source, exercises });
        const before = kept.read(`answer/${this.number}`);
        this.verdict = before?.verdict ?? null;
        this.editor = new Editor({
            source: before?.source ?? this.stub,
            label: `Your answer to exercise ${this.number}; Shift and Enter check it`,
            act: () => exercises.check(this),
            change: () => this.keep(),
            runtime: exercises.runtime,
        });
        this.status = status('browser-status');
        this.result = element('div', { className: 'browser-result', hidden: true });
        this.said = status('browser-verdict');
        this.stopButton = button('Stop', () => exercises.stop(), `Stop the check of exercise ${this.number}`);
        this.stopButton.hidden = true;
        const place = element('div', { className: 'browser-exercise' },
            element('p', { className: 'browser-label', textContent: 'Your answer' }), this.editor.place,
            element('div', { className: 'browser-tools' },
                button('Check', () => exercises.check(this), `Check exercise ${this.number}`), this.stopButton,
                button('Begin anew', () => this.beginAnew(), `Begin anew: exercise ${this.number}`), this.status),
            this.result, this.said);
        place.setAttribute('role', 'group');
        place.setAttribute('aria-label', `Answer to exercise ${this.number}`);
        document.getElementById(this.label).append(place);
        this.editor.mirror.refresh();
        this.showVerdict();
    }

    keep() {
        if (this.verdict?.source !== this.editor.value) this.verdict = null;
        const answer = { source: this.editor.value, verdict: this.verdict };
        if (!kept.write(`answer/${this.number}`, answer)) this.say('this browser keeps no answers: save the file', 'failed');
        this.showVerdict();
    }

    beginAnew() {
        this.editor.value = this.stub;
        this.verdict = null;
        kept.remove(`answer/${this.number}`);
        this.result.replaceChildren();
        this.result.hidden = true;
        this.say('');
        this.showVerdict();
    }

    say(text, kind = '') {
        this.status.textContent = text;
        this.status.dataset.kind = kind;
    }

    showVerdict() {
        this.said.textContent = this.verdict?.text ?? '';
        this.said.dataset.kind = this.verdict?.right ? 'done' : 'failed';
    }

    /** Run the answer and grade it. */
    async run(runtime) {
        const source = this.editor.value;
        this.verdict = null;
        this.showVerdict();
        this.result.replaceChildren();
        const onoutput = output => {
            if (output.type === 'verdict') this.verdict = { source, right: output.right, text: output.text };
            else show(output, this.result);
            this.result.hidden = this.result.childElementCount === 0;
        };
        const name = `answer_${this.number.replace('.', '_')}`;
        const begin = performance.now();
        let { error } = await runtime.run(source, { name, onoutput });
        error ??= (await runtime.run(`${GRADE}(${JSON.stringify(this.number)}, ${JSON.stringify(this.name)})`, { name: 'grade', onoutput })).error;
        if (error) onoutput({ type: 'stderr', text: error.text });
        this.say(error ? 'failed' : `checked in ${((performance.now() - begin) / 1000).toFixed(1)} s`, error ? 'failed' : 'done');
        this.keep();
    }
}

/** All exercises of the page, and the one session that grades them. */
class Exercises {
    constructor() {
        const stored = JSON.parse(document.getElementById('browser-exercises').textContent);
        this.limitS = LIMIT_S;
        this.runtime = new Runtime({ onprogress: share => this.progress(share) });
        this.turns = Promise.resolve();
        this.stopped = 0;
        const heading = document.getElementById(stored[0].label).closest('section').querySelector('h2, h3');
        this.guessButton = button('Save predictions.json', () => save('predictions.json', this.predictions, 'application/json'));
        this.guessButton.hidden = !this.predictions;
        heading.after(element('div', { className: 'browser-course' },
            element('p', {}, 'Write your answers below, and check them here: by the graders of the notebook, with the same hints, and ',
                element('strong', { textContent: 'not for marks' }), '. An answer runs by itself, without the cells above: it imports what it needs. '
                + 'What you write is kept in this browser alone. The file that you save is a notebook for ',
                element('code', { textContent: `trinolab check ${stored[0].number.slice(0, 2)}` }), '; first guesses to predictions go with it, in predictions.json.'),
            element('div', { className: 'browser-tools' },
                button(`Save ${CHAPTER}.ipynb`, () => save(`${CHAPTER}.ipynb`, this.notebook(), 'application/x-ipynb+json')), this.guessButton)));
        this.answers = stored.map(about => new Answer(about, this));
    }

    /** First guesses, as the graders write them; empty if there are none. */
    get predictions() {
        return kept.read('predictions') ?? '';
    }

    progress(share) {
        this.current?.say(share < 1 ? `loading the runtime: ${Math.round(100 * share)} %` : 'starting Python');
    }

    /** Check an answer, after those that wait already. */
    check(answer) {
        const round = this.stopped;
        const turn = async () => {
            if (round !== this.stopped) return answer.say('');
            this.current = answer;
            answer.stopButton.hidden = false;
            let limit = null;
            try {
                answer.say('starting Python');
                await this.start();
                answer.say('running');
                limit = setTimeout(() => this.stop(`stopped after ${this.limitS} s`), 1000 * this.limitS);
                await answer.run(this.runtime);
                await this.takePredictions();
            } catch (error) {
                this.end(answer, error);
            } finally {
                clearTimeout(limit);
                answer.stopButton.hidden = true;
            }
        };
        if (this.current) answer.say('waits');
        this.turns = this.turns.then(turn);
        return this.turns;
    }

    async start() {
        if (this.started) return;
        await this.runtime.start();
        if (this.predictions) await this.runtime.write(PREDICTIONS, new TextEncoder().encode(this.predictions).buffer);
        this.started = true;
    }

    /** End the session, now: nothing else ends a loop without an end. */
    stop(why = 'stopped') {
        this.why = why;
        this.stopped += 1;
        this.started = false;
        this.runtime.interrupt();
    }

    end(answer, error) {
        if (this.started) this.stop(error.message); // Python itself has ended
        this.started = false;
        answer.say(`${this.why ?? error.message}: does ${answer.name} end? What the session had is lost; your answers are kept.`, 'failed');
        this.why = null;
        answer.keep();
    }

    async takePredictions() {
        const bytes = await this.runtime.read(PREDICTIONS);
        if (!bytes) return;
        kept.write('predictions', new TextDecoder().decode(bytes));
        this.guessButton.hidden = false;
    }

    /** The answers as a notebook, which `trinolab check` reads. */
    notebook() {
        const cells = [['code', 'from workbench.course import check']];
        for (const answer of this.answers) {
            cells.push(['markdown', `## ${answer.number} ${answer.title}`], ['code', answer.editor.value], ['code', answer.check]);
        }
        return JSON.stringify({
            cells: cells.map(([kind, source], k) => ({
                cell_type: kind, id: `answer-${k}`, metadata: {}, source,
                ...(kind === 'code' ? { execution_count: null, outputs: [] } : {}),
            })),
            metadata: { kernelspec: { display_name: 'Python 3', language: 'python', name: 'python3' } },
            nbformat: 4,
            nbformat_minor: 5,
        }, null, 1);
    }
}

window.exercises = new Exercises();
