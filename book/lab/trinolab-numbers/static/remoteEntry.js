// A chapter in JupyterLab as on its page.
//
// Cells that the page folds are folded, and the cell of the parameters says that it is meant to be changed.
//
// A chapter stores a number once, myst_nb.glue("lamp_s", 1.23), and its text quotes it by the role
// {glue:text}`lamp_s:.1f`. The pages resolve that when they are built. In JupyterLab jupyterlab-myst
// does not know the role and shows its content, "lamp_s:.1f"; this extension puts the number there, from
// the outputs of the notebook's own cells, and anew whenever a cell has run. It also hides the numbers that
// jupyterlab-myst gives to equations: the book's equations have the paper's.

const ROLE = /\{glue:text\}`([^`]+)`/g;
const RECORD = "application/papermill.record/text/plain";
const NOT_YET = "…";
const STYLE = `
  .myst a[aria-label="Link to this Equation"] { display: none; }
  .trinolab-parameters::before { content: "The parameters: change these, and run the chapter again."; font-weight: 600; }
`;

/** A stored value in one of Python's formats: .2f, +.3f, .0%, .3g, g, or none. */
function formatted(stored, format) {
  const quoted = stored.match(/^(['"])(.*)\1$/s);
  if (quoted) return quoted[2];
  const [, sign, digits, kind] = format.match(/^(\+?)(?:\.(\d+))?([fg%])$/) || [];
  const value = Number(stored);
  if (!kind || !Number.isFinite(value)) return stored;
  return (sign && value >= 0 ? "+" : "") + unsigned(value, digits, kind);
}

/** Python's formats without a sign for what is positive. */
function unsigned(value, digits, kind) {
  if (kind === "f") return value.toFixed(digits ?? 6);
  if (kind === "%") return (100 * value).toFixed(digits ?? 6) + "%";
  return general(value, Math.max(1, digits ?? 6));
}

/** Python's g: so many digits, and an exponent for what is very small or large. */
function general(value, digits) {
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  if (exponent >= -4 && exponent < digits) return String(Number(value.toPrecision(digits)));
  return `${Number(mantissa)}e${exponent[0]}${exponent.slice(1).padStart(2, "0")}`;
}

/** Name -> stored text of all numbers that the notebook's cells have given so far. */
function storedNumbers(notebook) {
  const numbers = new Map();
  for (const cell of notebook.widgets) {
    for (const output of cell.model.outputs?.toJSON() ?? []) {
      const name = output.metadata?.scrapbook?.name;
      if (name && RECORD in output.data) numbers.set(name, String([output.data[RECORD]].flat().join("")));
    }
  }
  return numbers;
}

/** Put the numbers into the rendered text of all cells that quote any. */
function fill(notebook) {
  const numbers = storedNumbers(notebook);
  for (const cell of notebook.widgets) {
    if (cell.model.type !== "markdown") continue;
    const quoted = new Set([...cell.model.sharedModel.source.matchAll(ROLE)].map((found) => found[1]));
    if (quoted.size === 0) continue;
    for (const span of cell.node.querySelectorAll(".myst span")) {
      if (span.childElementCount > 0) continue;
      // the text is ours, or was rendered anew since
      const said = span.textContent === span.dataset.shown ? span.dataset.quoted : span.textContent;
      if (!quoted.has(said)) continue;
      const [name, format = ""] = said.split(":");
      const shown = numbers.has(name) ? formatted(numbers.get(name), format) : NOT_YET;
      if (span.textContent !== shown) span.textContent = shown;
      span.title = numbers.has(name) ? name : `${name}: run the cells above`;
      span.dataset.quoted = said;
      span.dataset.shown = shown;
    }
  }
}

const folded = new WeakSet();

/** Fold the cells that the page folds, each once and without a change of the file; mark the parameters. */
function fold(notebook) {
  for (const cell of notebook.widgets) {
    if (folded.has(cell.model)) continue;
    folded.add(cell.model);
    const tags = cell.model.getMetadata("tags") ?? [];
    cell.toggleClass("trinolab-parameters", tags.includes("parameters"));
    if (!tags.includes("hide-input")) continue;
    cell.syncCollapse = false;
    cell.inputHidden = true;
  }
}

function activate(app) {
  const known = new WeakSet();
  let waiting = false;
  const soon = () => {
    if (waiting) return;
    waiting = true;
    setTimeout(() => {
      waiting = false;
      fillAll();
    }, 100);
  };
  const fillAll = () => {
    for (const panel of app.shell.widgets("main")) {
      const notebook = panel.content;
      if (!notebook?.widgets || !notebook.model?.cells) continue;
      if (!known.has(notebook.model)) {
        known.add(notebook.model);
        notebook.model.contentChanged.connect(soon);
      }
      fold(notebook);
      fill(notebook);
    }
  };
  document.head.append(Object.assign(document.createElement("style"), { textContent: STYLE }));
  new MutationObserver(soon).observe(app.shell.node, { childList: true, subtree: true });
}

const plugin = { id: "trinolab-numbers:plugin", autoStart: true, activate };

// what webpack's module federation would have made of the above, as JupyterLab asks for it
globalThis._JUPYTERLAB = globalThis._JUPYTERLAB ?? {};
globalThis._JUPYTERLAB["trinolab-numbers"] = {
  init: () => {},
  get: () => Promise.resolve(() => ({ __esModule: true, default: plugin })),
};
