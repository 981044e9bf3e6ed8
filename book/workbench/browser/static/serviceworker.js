// Keeps the runtime's files and the recordings, so that they are loaded once.
const KEPT = 'trinolab-VERSION';

self.addEventListener('install', () => self.skipWaiting());
self.addEventListener('activate', event => event.waitUntil((async () => {
    const names = await caches.keys();
    await Promise.all(names.filter(name => name !== KEPT).map(name => caches.delete(name)));
    await self.clients.claim();
})()));
self.addEventListener('fetch', event => {
    if (!/\/_browser\/(files|recordings)\//.test(event.request.url)) return;
    event.respondWith((async () => {
        const cache = await caches.open(KEPT);
        const known = await cache.match(event.request);
        if (known) return known;
        const response = await fetch(event.request);
        if (response.ok) await cache.put(event.request, response.clone()).catch(() => {});
        return response;
    })());
});
