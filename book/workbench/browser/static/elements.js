// Pieces of a page.

export function element(tag, about = {}, ...children) {
    const made = Object.assign(document.createElement(tag), about);
    made.append(...children);
    return made;
}

export function button(text, act, label = text) {
    const made = element('button', { type: 'button', textContent: text, className: 'browser-button' });
    made.setAttribute('aria-label', label);
    made.addEventListener('click', act);
    return made;
}

/** A line that a screen reader reads when it changes. */
export function status(className) {
    const made = element('span', { className });
    made.setAttribute('role', 'status');
    return made;
}

/** Let the reader save a text as a file. */
export function save(name, text, type) {
    const address = URL.createObjectURL(new Blob([text], { type }));
    const link = element('a', { href: address, download: name });
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
}
