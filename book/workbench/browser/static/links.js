// Links that carry the source of a cell: its number, and the source as packed bytes, behind the #.

async function through(bytes, stream) {
    return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(stream)).arrayBuffer());
}

export async function linkTo(number, source) {
    const packed = await through(source, new CompressionStream('deflate-raw'));
    const text = btoa(String.fromCharCode(...packed)).replaceAll('+', '-').replaceAll('/', '_').replaceAll('=', '');
    return `#cell-${number}=${text}`;
}

/** What this page's own link carries: {number, source}, or null. */
export async function linked() {
    const [, number, text] = location.hash.match(/^#cell-(\d+)=([\w-]+)$/) ?? [];
    if (!number) return null;
    const packed = Uint8Array.from(atob(text.replaceAll('-', '+').replaceAll('_', '/')), one => one.charCodeAt(0));
    return { number: Number(number), source: new TextDecoder().decode(await through(packed, new DecompressionStream('deflate-raw'))) };
}
