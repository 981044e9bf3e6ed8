// Finished runs of sweeps, kept in this browser (IndexedDB) by a key that says what they were made from.
const [DATABASE, STORE] = ['trinolab', 'runs'];

function answered(request) {
    return new Promise((resolve, reject) => {
        request.onsuccess = () => resolve(request.result);
        request.onerror = () => reject(request.error);
    });
}

let opened = null;

async function store(mode) {
    if (!opened) {
        const request = indexedDB.open(DATABASE, 1);
        request.onupgradeneeded = () => request.result.createObjectStore(STORE);
        opened = answered(request);
    }
    return (await opened).transaction(STORE, mode).objectStore(STORE);
}

export const runs = {
    get: async key => answered((await store('readonly')).get(key)),
    put: async (key, value) => answered((await store('readwrite')).put(value, key)),
    /** Forget all whose keys begin so. */
    forget: async begin => answered((await store('readwrite')).delete(IDBKeyRange.bound(begin, `${begin}\uffff`))),
};
