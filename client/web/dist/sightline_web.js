/**
 * The client of a page.
 */
export class Client {
    __destroy_into_raw() {
        const ptr = this.__wbg_ptr;
        this.__wbg_ptr = 0;
        ClientFinalization.unregister(this);
        return ptr;
    }
    free() {
        const ptr = this.__destroy_into_raw();
        wasm.__wbg_client_free(ptr, 0);
    }
    /**
     * The connection has ended, or none could be made, for a reason in words.
     * @param {number} now_ms
     * @param {string} reason
     */
    closed(now_ms, reason) {
        const val2 = +now_ms;
        const ptr0 = passStringToWasm0(reason, wasm.__wbindgen_malloc, wasm.__wbindgen_realloc);
        const len0 = WASM_VECTOR_LEN;
        wasm.client_closed(this.__wbg_ptr, val2, ptr0, len0);
    }
    /**
     * Bytes of the control stream have arrived.
     * @param {number} now_ms
     * @param {Uint8Array | number[]} bytes
     */
    control(now_ms, bytes) {
        const val2 = +now_ms;
        const ptr0 = passArray8ToWasm0(bytes, wasm.__wbindgen_malloc);
        const len0 = WASM_VECTOR_LEN;
        wasm.client_control(this.__wbg_ptr, val2, ptr0, len0);
    }
    /**
     * A datagram has arrived.
     * @param {number} now_ms
     * @param {Uint8Array | number[]} bytes
     */
    datagram(now_ms, bytes) {
        const val2 = +now_ms;
        const ptr0 = passArray8ToWasm0(bytes, wasm.__wbindgen_malloc);
        const len0 = WASM_VECTOR_LEN;
        wasm.client_datagram(this.__wbg_ptr, val2, ptr0, len0);
    }
    /**
     * Draws what one sees now. Returns whether the picture has changed since the last call.
     * @param {number} now_ms
     * @param {number} columns
     * @param {number} rows
     * @returns {boolean}
     */
    draw(now_ms, columns, rows) {
        const ret = wasm.client_draw(this.__wbg_ptr, now_ms, columns, rows);
        return ret !== 0;
    }
    /**
     * Takes in how long a new picture took until it was on the page, in milliseconds.
     * @param {number} milliseconds
     */
    drew(milliseconds) {
        wasm.client_drew(this.__wbg_ptr, milliseconds);
    }
    /**
     * Gives what was wanted. Bytes that are not wanted are ignored.
     * @param {Uint8Array | number[]} bytes
     */
    give(bytes) {
        const ptr0 = passArray8ToWasm0(bytes, wasm.__wbindgen_malloc);
        const len0 = WASM_VECTOR_LEN;
        wasm.client_give(this.__wbg_ptr, ptr0, len0);
    }
    /**
     * Gives what was at the path of pieces, without those whose numbers are `refused`, with commas
     * between them; nothing when it could not be had. Then they are asked for again.
     * @param {string} path
     * @param {Uint8Array | number[] | null | undefined} bytes
     * @param {string} refused
     */
    give_pieces(path, bytes, refused) {
        let ptr0, len0, ptr1, len1, ptr2, len2;
        try {
            ptr0 = passStringToWasm0(path, wasm.__wbindgen_malloc, wasm.__wbindgen_realloc);
            len0 = WASM_VECTOR_LEN;
            ptr1 = isLikeNone(bytes) ? 0 : passArray8ToWasm0(bytes, wasm.__wbindgen_malloc);
            len1 = WASM_VECTOR_LEN;
            ptr2 = passStringToWasm0(refused, wasm.__wbindgen_malloc, wasm.__wbindgen_realloc);
            len2 = WASM_VECTOR_LEN;
        } catch (e) {
            if (ptr2) { wasm.__wbindgen_free(ptr2, len2 * 1, 1); }
            if (ptr1) { wasm.__wbindgen_free(ptr1, len1 * 1, 1); }
            if (ptr0) { wasm.__wbindgen_free(ptr0, len0 * 1, 1); }
            throw e;
        }
        wasm.client_give_pieces(this.__wbg_ptr, ptr0, len0, ptr1, len1, ptr2, len2);
    }
    /**
     * Asks to be put back to the entrance.
     */
    go_home() {
        wasm.client_go_home(this.__wbg_ptr);
    }
    /**
     * Walks to the floor below a point of the world, in metres. Returns whether a way leads there.
     * While not all of the building is here, that is not known, and the way is found later.
     * @param {number} x
     * @param {number} y
     * @param {number} z
     * @returns {boolean}
     */
    go_to(x, y, z) {
        const ret = wasm.client_go_to(this.__wbg_ptr, x, y, z);
        return ret !== 0;
    }
    /**
     * Whether the client is in a world, on a connection that stands.
     * @returns {boolean}
     */
    is_in() {
        const ret = wasm.client_is_in(this.__wbg_ptr);
        return ret !== 0;
    }
    /**
     * Whether there is enough of the building for a picture.
     * @returns {boolean}
     */
    is_open() {
        const ret = wasm.client_is_open(this.__wbg_ptr);
        return ret !== 0;
    }
    /**
     * Whether the server or the client has ended the connection.
     * @returns {boolean}
     */
    is_over() {
        const ret = wasm.client_is_over(this.__wbg_ptr);
        return ret !== 0;
    }
    /**
     * Says goodbye: the page is being closed.
     */
    leave() {
        wasm.client_leave(this.__wbg_ptr);
    }
    /**
     * Takes the plan of the storey that one is on, or goes on making it, by some rows. Returns
     * whether there is another one now.
     * @param {number} rows
     * @returns {boolean}
     */
    make_plan(rows) {
        const ret = wasm.client_make_plan(this.__wbg_ptr, rows);
        return ret !== 0;
    }
    /**
     * Whether a plan is being made.
     * @returns {boolean}
     */
    makes_plan() {
        const ret = wasm.client_makes_plan(this.__wbg_ptr);
        return ret !== 0;
    }
    /**
     * A client that will call itself so, with a colour as 0xRRGGBB, a secret of 32 bytes by which
     * the server knows it again, and an invitation where one is needed (empty where none is).
     *
     * # Errors
     * When one of them cannot be taken: the reason, in words.
     * @param {string} name
     * @param {number} colour
     * @param {Uint8Array | number[]} secret
     * @param {string} invitation
     */
    constructor(name, colour, secret, invitation) {
        const val4 = +colour;
        let ptr0, len0, ptr1, len1, ptr2, len2;
        try {
            ptr0 = passStringToWasm0(name, wasm.__wbindgen_malloc, wasm.__wbindgen_realloc);
            len0 = WASM_VECTOR_LEN;
            ptr1 = passArray8ToWasm0(secret, wasm.__wbindgen_malloc);
            len1 = WASM_VECTOR_LEN;
            ptr2 = passStringToWasm0(invitation, wasm.__wbindgen_malloc, wasm.__wbindgen_realloc);
            len2 = WASM_VECTOR_LEN;
        } catch (e) {
            if (ptr2) { wasm.__wbindgen_free(ptr2, len2 * 1, 1); }
            if (ptr1) { wasm.__wbindgen_free(ptr1, len1 * 1, 1); }
            if (ptr0) { wasm.__wbindgen_free(ptr0, len0 * 1, 1); }
            throw e;
        }
        const ret = wasm.client_new(ptr0, len0, val4, ptr1, len1, ptr2, len2);
        if (ret[2]) {
            throw takeFromExternrefTable0(ret[1]);
        }
        this.__wbg_ptr = ret[0];
        ClientFinalization.register(this, this.__wbg_ptr, this);
        return this;
    }
    /**
     * The path of pieces to fetch now, if there are any. With those that are under way they take at
     * most `bytes_max` bytes, or are one.
     * @param {number} bytes_max
     * @returns {string | undefined}
     */
    next_pieces(bytes_max) {
        const ret = wasm.client_next_pieces(this.__wbg_ptr, bytes_max);
        let v1;
        if (ret[0] !== 0) {
            v1 = getStringFromWasm0(ret[0], ret[1]);
            wasm.__wbindgen_free(ret[0], ret[1] * 1, 1);
        }
        return v1;
    }
    /**
     * A connection is open: the client says hello.
     * @param {number} now_ms
     */
    opened(now_ms) {
        wasm.client_opened(this.__wbg_ptr, now_ms);
    }
    /**
     * Where the bytes of the picture begin in the memory: red, green, blue and 255 for each pixel,
     * row by row.
     * @returns {number}
     */
    pixels() {
        const ret = wasm.client_pixels(this.__wbg_ptr);
        return ret >>> 0;
    }
    /**
     * Where the plan is, in metres and pixels, as JSON; empty before there is one.
     * @returns {string}
     */
    plan() {
        let deferred1_0;
        let deferred1_1;
        try {
            const ret = wasm.client_plan(this.__wbg_ptr);
            deferred1_0 = ret[0];
            deferred1_1 = ret[1];
            return getStringFromWasm0(ret[0], ret[1]);
        } finally {
            wasm.__wbindgen_free(deferred1_0, deferred1_1, 1);
        }
    }
    /**
     * The pixels of the plan: red, green, blue and opacity for each, row by row.
     * @returns {Uint8Array}
     */
    plan_pixels() {
        const ret = wasm.client_plan_pixels(this.__wbg_ptr);
        var v1 = getArrayU8FromWasm0(ret[0], ret[1]).slice();
        wasm.__wbindgen_free(ret[0], ret[1] * 1, 1);
        return v1;
    }
    /**
     * The rooms that the author of the building has declared, as a JSON list.
     * @returns {string}
     */
    rooms() {
        let deferred1_0;
        let deferred1_1;
        try {
            const ret = wasm.client_rooms(this.__wbg_ptr);
            deferred1_0 = ret[0];
            deferred1_1 = ret[1];
            return getStringFromWasm0(ret[0], ret[1]);
        } finally {
            wasm.__wbindgen_free(deferred1_0, deferred1_1, 1);
        }
    }
    /**
     * What was said, and what happened, since the last call, as a JSON list.
     * @returns {string}
     */
    said() {
        let deferred1_0;
        let deferred1_1;
        try {
            const ret = wasm.client_said(this.__wbg_ptr);
            deferred1_0 = ret[0];
            deferred1_1 = ret[1];
            return getStringFromWasm0(ret[0], ret[1]);
        } finally {
            wasm.__wbindgen_free(deferred1_0, deferred1_1, 1);
        }
    }
    /**
     * Says something to those in sight. Returns why it cannot be said, if it cannot.
     * @param {string} text
     * @returns {string | undefined}
     */
    say(text) {
        const ptr0 = passStringToWasm0(text, wasm.__wbindgen_malloc, wasm.__wbindgen_realloc);
        const len0 = WASM_VECTOR_LEN;
        const ret = wasm.client_say(this.__wbg_ptr, ptr0, len0);
        let v2;
        if (ret[0] !== 0) {
            v2 = getStringFromWasm0(ret[0], ret[1]);
            wasm.__wbindgen_free(ret[0], ret[1] * 1, 1);
        }
        return v2;
    }
    /**
     * The share of the building that is here, from 0 to 1.
     * @returns {number}
     */
    share() {
        const ret = wasm.client_share(this.__wbg_ptr);
        return ret;
    }
    /**
     * The size to draw in for a canvas of this many device pixels, so that it is drawn often
     * enough: columns and rows.
     * @param {number} now_ms
     * @param {number} columns
     * @param {number} rows
     * @returns {Uint32Array}
     */
    size(now_ms, columns, rows) {
        const ret = wasm.client_size(this.__wbg_ptr, now_ms, columns, rows);
        var v1 = getArrayU32FromWasm0(ret[0], ret[1]).slice();
        wasm.__wbindgen_free(ret[0], ret[1] * 4, 4);
        return v1;
    }
    /**
     * How the client stands, where it is and who is near, as JSON.
     * @param {number} now_ms
     * @returns {string}
     */
    state(now_ms) {
        let deferred1_0;
        let deferred1_1;
        try {
            const ret = wasm.client_state(this.__wbg_ptr, now_ms);
            deferred1_0 = ret[0];
            deferred1_1 = ret[1];
            return getStringFromWasm0(ret[0], ret[1]);
        } finally {
            wasm.__wbindgen_free(deferred1_0, deferred1_1, 1);
        }
    }
    /**
     * Moves the body on to a moment, as far as the connection allows it. Forward and right are
     * shares of the greatest speed, from -1 to 1.
     * @param {number} now_ms
     * @param {number} forward
     * @param {number} right
     * @param {number} up
     * @param {boolean} jump
     * @param {boolean} fly
     */
    step(now_ms, forward, right, up, jump, fly) {
        wasm.client_step(this.__wbg_ptr, now_ms, forward, right, up, jump, fly);
    }
    /**
     * Stops walking to a place.
     */
    stop() {
        wasm.client_stop(this.__wbg_ptr);
    }
    /**
     * The bytes to send on the control stream; empty when there are none.
     * @returns {Uint8Array}
     */
    take_control() {
        const ret = wasm.client_take_control(this.__wbg_ptr);
        var v1 = getArrayU8FromWasm0(ret[0], ret[1]).slice();
        wasm.__wbindgen_free(ret[0], ret[1] * 1, 1);
        return v1;
    }
    /**
     * The next datagram to send.
     * @returns {Uint8Array | undefined}
     */
    take_datagram() {
        const ret = wasm.client_take_datagram(this.__wbg_ptr);
        let v1;
        if (ret[0] !== 0) {
            v1 = getArrayU8FromWasm0(ret[0], ret[1]).slice();
            wasm.__wbindgen_free(ret[0], ret[1] * 1, 1);
        }
        return v1;
    }
    /**
     * Whatever the client sends by itself becomes due. To be called at each tick.
     * @param {number} now_ms
     */
    tick(now_ms) {
        wasm.client_tick(this.__wbg_ptr, now_ms);
    }
    /**
     * The server's time from tick to tick, in milliseconds.
     * @returns {number}
     */
    tick_ms() {
        const ret = wasm.client_tick_ms(this.__wbg_ptr);
        return ret;
    }
    /**
     * Draws what rooms hide from the eye from now on, or leaves it out again. Returns false where
     * the author of the building has declared no rooms.
     * @returns {boolean}
     */
    toggle_hidden() {
        const ret = wasm.client_toggle_hidden(this.__wbg_ptr);
        return ret !== 0;
    }
    /**
     * Turns the view, in radians.
     * @param {number} left
     * @param {number} up
     */
    turn(left, up) {
        wasm.client_turn(this.__wbg_ptr, left, up);
    }
    /**
     * The path of what the client needs before it can come in: the file of a world, or its head.
     * @returns {string | undefined}
     */
    wanted() {
        const ret = wasm.client_wanted(this.__wbg_ptr);
        let v1;
        if (ret[0] !== 0) {
            v1 = getStringFromWasm0(ret[0], ret[1]);
            wasm.__wbindgen_free(ret[0], ret[1] * 1, 1);
        }
        return v1;
    }
}
if (Symbol.dispose) Client.prototype[Symbol.dispose] = Client.prototype.free;
function __wbg_get_imports() {
    const import0 = {
        __proto__: null,
        __wbg_Error_208446807d0d1e30: function(arg0, arg1) {
            const ret = Error(getStringFromWasm0(arg0, arg1));
            return ret;
        },
        __wbg___wbindgen_throw_4c88d8bf264fd984: function(arg0, arg1) {
            throw new Error(getStringFromWasm0(arg0, arg1));
        },
        __wbindgen_init_externref_table: function() {
            const table = wasm.__wbindgen_externrefs;
            table.set(0, undefined);
            table.set(1024, undefined);
            table.set(1025, null);
            table.set(1026, true);
            table.set(1027, false);
        },
    };
    return {
        __proto__: null,
        "./sightline_web_bg.js": import0,
    };
}

const ClientFinalization = (typeof FinalizationRegistry === 'undefined')
    ? { register: () => {}, unregister: () => {} }
    : new FinalizationRegistry(ptr => wasm.__wbg_client_free(ptr, 1));

function getArrayU32FromWasm0(ptr, len) {
    ptr = ptr >>> 0;
    return getUint32ArrayMemory0().subarray(ptr / 4, ptr / 4 + len);
}

function getArrayU8FromWasm0(ptr, len) {
    ptr = ptr >>> 0;
    return getUint8ArrayMemory0().subarray(ptr / 1, ptr / 1 + len);
}

function getStringFromWasm0(ptr, len) {
    ptr = ptr >>> 0;
    return decodeText(getUint8ArrayMemory0().subarray(ptr, ptr + len));
}

let cachedUint32ArrayMemory0 = null;
function getUint32ArrayMemory0() {
    if (cachedUint32ArrayMemory0 === null || cachedUint32ArrayMemory0.byteLength === 0) {
        cachedUint32ArrayMemory0 = new Uint32Array(wasm.memory.buffer);
    }
    return cachedUint32ArrayMemory0;
}

let cachedUint8ArrayMemory0 = null;
function getUint8ArrayMemory0() {
    if (cachedUint8ArrayMemory0 === null || cachedUint8ArrayMemory0.byteLength === 0) {
        cachedUint8ArrayMemory0 = new Uint8Array(wasm.memory.buffer);
    }
    return cachedUint8ArrayMemory0;
}

function isLikeNone(x) {
    return x === undefined || x === null;
}

function passArray8ToWasm0(arg, malloc) {
    const ptr = malloc(arg.length * 1, 1) >>> 0;
    getUint8ArrayMemory0().set(arg, ptr / 1);
    WASM_VECTOR_LEN = arg.length;
    return ptr;
}

function passStringToWasm0(arg, malloc, realloc) {
    if (realloc === undefined) {
        const buf = cachedTextEncoder.encode(arg);
        const ptr = malloc(buf.length, 1) >>> 0;
        getUint8ArrayMemory0().subarray(ptr, ptr + buf.length).set(buf);
        WASM_VECTOR_LEN = buf.length;
        return ptr;
    }

    let len = arg.length;
    let ptr = malloc(len, 1) >>> 0;

    const mem = getUint8ArrayMemory0();

    let offset = 0;

    for (; offset < len; offset++) {
        const code = arg.charCodeAt(offset);
        if (code > 0x7F) break;
        mem[ptr + offset] = code;
    }
    if (offset !== len) {
        if (offset !== 0) {
            arg = arg.slice(offset);
        }
        ptr = realloc(ptr, len, len = offset + arg.length * 3, 1) >>> 0;
        const view = getUint8ArrayMemory0().subarray(ptr + offset, ptr + len);
        const ret = cachedTextEncoder.encodeInto(arg, view);

        offset += ret.written;
        ptr = realloc(ptr, len, offset, 1) >>> 0;
    }

    WASM_VECTOR_LEN = offset;
    return ptr;
}

function takeFromExternrefTable0(idx) {
    const value = wasm.__wbindgen_externrefs.get(idx);
    wasm.__externref_table_dealloc(idx);
    return value;
}

let cachedTextDecoder = new TextDecoder('utf-8', { ignoreBOM: true });
cachedTextDecoder.decode();
const MAX_SAFARI_DECODE_BYTES = 2146435072;
let numBytesDecoded = 0;
function decodeText(bytes) {
    numBytesDecoded += bytes.length;
    if (numBytesDecoded >= MAX_SAFARI_DECODE_BYTES) {
        cachedTextDecoder = new TextDecoder('utf-8', { ignoreBOM: true });
        cachedTextDecoder.decode();
        numBytesDecoded = bytes.length;
    }
    return cachedTextDecoder.decode(bytes);
}

const cachedTextEncoder = new TextEncoder();

if (!('encodeInto' in cachedTextEncoder)) {
    cachedTextEncoder.encodeInto = function (arg, view) {
        const buf = cachedTextEncoder.encode(arg);
        view.set(buf);
        return {
            read: arg.length,
            written: buf.length
        };
    };
}

let WASM_VECTOR_LEN = 0;

let wasmModule, wasmInstance, wasm;
function __wbg_finalize_init(instance, module) {
    wasmInstance = instance;
    wasm = instance.exports;
    wasmModule = module;
    cachedUint32ArrayMemory0 = null;
    cachedUint8ArrayMemory0 = null;
    wasm.__wbindgen_start();
    return wasm;
}

async function __wbg_load(module, imports) {
    if (typeof Response === 'function' && module instanceof Response) {
        if (!module.ok) {
            throw new Error(`failed to fetch Wasm: ${module.status} ${module.statusText} fetching '${module.url}'`);
        }

        if (typeof WebAssembly.instantiateStreaming === 'function') {
            try {
                return await WebAssembly.instantiateStreaming(module, imports);
            } catch (e) {
                const validResponse = expectedResponseType(module.type);

                if (validResponse && module.headers.get('Content-Type') !== 'application/wasm') {
                    console.warn("`WebAssembly.instantiateStreaming` failed because your server does not serve Wasm with `application/wasm` MIME type. Falling back to `WebAssembly.instantiate` which is slower. Original error:\n", e);

                } else { throw e; }
            }
        }

        const bytes = await module.arrayBuffer();
        return await WebAssembly.instantiate(bytes, imports);
    } else {
        const instance = await WebAssembly.instantiate(module, imports);

        if (instance instanceof WebAssembly.Instance) {
            return { instance, module };
        } else {
            return instance;
        }
    }

    function expectedResponseType(type) {
        switch (type) {
            case 'basic': case 'cors': case 'default': return true;
        }
        return false;
    }
}

function initSync(module) {
    if (wasm !== undefined) return wasm;


    if (module !== undefined) {
        if (Object.getPrototypeOf(module) === Object.prototype) {
            ({module} = module)
        } else {
            console.warn('using deprecated parameters for `initSync()`; pass a single object instead')
        }
    }

    const imports = __wbg_get_imports();
    if (!(module instanceof WebAssembly.Module)) {
        module = new WebAssembly.Module(module);
    }
    const instance = new WebAssembly.Instance(module, imports);
    return __wbg_finalize_init(instance, module);
}

let __wbg_init_promise;
async function __wbg_init(module_or_path) {
    if (wasm !== undefined) return wasm;
    if (__wbg_init_promise === undefined) {
        __wbg_init_promise = __wbg_init_once(module_or_path);
        __wbg_init_promise.catch(() => { __wbg_init_promise = undefined; });
    }
    return __wbg_init_promise;
}

async function __wbg_init_once(module_or_path) {

    if (module_or_path !== undefined) {
        if (Object.getPrototypeOf(module_or_path) === Object.prototype) {
            ({module_or_path} = module_or_path)
        } else {
            console.warn('using deprecated parameters for the initialization function; pass a single object instead')
        }
    }


    const imports = __wbg_get_imports();

    if (typeof module_or_path === 'string' || (typeof Request === 'function' && module_or_path instanceof Request) || (typeof URL === 'function' && module_or_path instanceof URL)) {
        module_or_path = fetch(module_or_path);
    }

    const { instance, module } = await __wbg_load(await module_or_path, imports);

    return __wbg_finalize_init(instance, module);
}

export { initSync, __wbg_init as default };
