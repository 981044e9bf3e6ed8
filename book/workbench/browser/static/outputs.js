// What a session hands out, on the page.

function appended(tag, place, className) {
    const made = document.createElement(tag);
    made.className = className;
    place.append(made);
    return made;
}

/** The stream's text block: what follows at once is written on in it. */
function stream(type, place) {
    if (place.lastElementChild?.dataset.stream === type) return place.lastElementChild;
    const made = appended('pre', place, `browser-text browser-${type}`);
    made.dataset.stream = type;
    return made;
}

export function show(output, place) {
    if (output.type === 'stdout' || output.type === 'stderr') {
        if (output.text !== '') stream(output.type, place).append(output.text); // a flush of nothing
    } else if (output.type === 'display') {
        const { 'image/png': png, 'text/html': html, 'text/plain': text } = output.data;
        if (png) {
            const image = appended('img', place, 'browser-image');
            image.src = `data:image/png;base64,${png}`;
            image.alt = 'A figure that this cell has drawn';
        } else if (html) {
            const made = appended('div', place, 'browser-html');
            made.innerHTML = html;
            window.MathJax?.typesetPromise?.([made]);
        } else if (text) {
            appended('pre', place, 'browser-text').textContent = text;
        }
    }
}
