// The kernels (core.wasm, referee.wasm) for JavaScript, in pages and in Node.
//
//     const core = await load(module);                 // the bytes of core.wasm
//     const { scene, scratch } = core.place(image);    // tables made by Python's `CollisionChecker.memory_image`
//     core.call("rr1_certify_edge", scene, scratch, [0, 0], [1, 2]) === core.constants.EDGE_FREE
//     scratch.result.fraction                          // fields of structs, as the C headers have them
//
// The module contains the declarations of all structs, constants and functions, made from the C headers
// (`binding/c_sources.py`). Nothing of them is repeated here.

// Views of numbers, and how many each item has.
const NUMBERS = {
  double: [Float64Array, 1],
  float: [Float32Array, 1],
  int64_t: [BigInt64Array, 1],
  uint64_t: [BigUint64Array, 1],
  int16_t: [Int16Array, 1],
  int32_t: [Int32Array, 1],
  int8_t: [Int8Array, 1],
  uint8_t: [Uint8Array, 1],
  f64x8: [Float64Array, 8],
};
const PAGE = 65536;
const ALIGNMENT = 64; // of vectors of eight numbers
// Of structs and arrays: their C type and address. No field of a struct can have these names.
const KIND = Symbol("kind");
const ADDRESS = Symbol("address");

/** Start a module; `module` is an ArrayBuffer or a view of one. */
export async function load(module) {
  const { instance } = await WebAssembly.instantiate(module, { math: Math });
  return new Core(instance.exports);
}

class Core {
  #exports;
  #top; // the first free address
  #classes = new Map();

  constructor(exports) {
    this.#exports = exports;
    this.#top = exports.__heap_base.value;
    const bytes = new Uint8Array(this.buffer, exports.rr1_declarations.value);
    this.declarations = JSON.parse(new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0))));
    this.constants = this.declarations.constants;
    for (const [kind, { fields }] of Object.entries(this.declarations.structs)) {
      this.#classes.set(kind, this.#structClass(kind, fields));
    }
  }

  /** The memory; another object once it has grown. */
  get buffer() {
    return this.#exports.memory.buffer;
  }

  /** The address of a struct or an array, or of data that the module exports by a name. */
  addressOf(given) {
    return typeof given === "string" ? this.#exports[given].value : given[ADDRESS];
  }

  /**
   * Call a kernel. A pointer takes a struct, an array, an address or null; also a JavaScript array, which is copied and
   * gone after the call. Results of 64 bits are numbers.
   */
  call(name, ...given) {
    const declared = this.declarations.functions[name];
    if (!declared) throw new TypeError(`core.wasm has no function ${name}`);
    const [, kinds] = declared;
    if (given.length !== kinds.length) {
      throw new TypeError(`${name} takes ${kinds.length} arguments (${kinds.join(", ")}), got ${given.length}`);
    }
    return this.scoped(() => {
      const result = this.#exports[name](...kinds.map((kind, i) => this.#argument(kind, given[i], `${name}, ${i + 1}`)));
      return typeof result === "bigint" ? Number(result) : result;
    });
  }

  /** Run a function; memory that is allocated meanwhile is free again afterwards. */
  scoped(run) {
    const top = this.#top;
    try {
      return run();
    } finally {
      this.#top = top;
    }
  }

  /** An array of the given numbers, or of that many zeros. */
  array(kind, values) {
    if (typeof values === "number") {
      return new CoreArray(this, kind, this.#allocate(values * this.#sizeOf(kind)), values);
    }
    const [Numbers, each] = NUMBERS[kind] ?? [];
    if (!Numbers || (ArrayBuffer.isView(values) && values.constructor !== Numbers)) {
      throw new TypeError(`${values.constructor.name} is not an array of ${kind}`);
    }
    const made = this.array(kind, values.length / each);
    const convert = Numbers === BigInt64Array || Numbers === BigUint64Array ? BigInt : Number;
    made.values.set(ArrayBuffer.isView(values) ? values : Array.from(values, convert));
    return made;
  }

  /** A new struct; fields that are not given are zero. */
  struct(kind, fields = {}) {
    return Object.assign(this.at(kind, this.#allocate(this.#sizeOf(kind))), fields);
  }

  /** The struct at an address. */
  at(kind, address) {
    const made = this.#classes.get(kind);
    if (!made) throw new TypeError(`core.wasm has no struct ${kind}`);
    return new made(address);
  }

  /** Copy a memory image (`binding/memory_image.py`). Returns its named structs and arrays. */
  place(image) {
    const bytes = ArrayBuffer.isView(image)
      ? new Uint8Array(image.buffer, image.byteOffset, image.byteLength)
      : new Uint8Array(image);
    const end = bytes.indexOf(10);
    if (bytes[0] !== 123 || end < 0) throw new TypeError("this is no memory image");
    const { digest, size, pointers, roots } = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
    if (digest !== this.declarations.digest) throw new TypeError("the memory image was made for another core.wasm");
    const base = this.#allocate(size);
    new Uint8Array(this.buffer, base).set(bytes.subarray(end + 1));
    const view = new DataView(this.buffer, base);
    for (const place of pointers) view.setUint32(place, view.getUint32(place, true) + base, true);
    const named = Object.entries(roots).map(([name, [kind, offset, count]]) => {
      const isStruct = this.#classes.has(kind) && count === 1;
      return [name, isStruct ? this.at(kind, base + offset) : new CoreArray(this, kind, base + offset, count)];
    });
    return Object.fromEntries(named);
  }

  /** Zeroed memory, aligned for vectors. */
  #allocate(size) {
    const begin = Math.ceil(this.#top / ALIGNMENT) * ALIGNMENT;
    const missing = begin + size - this.buffer.byteLength;
    if (missing > 0) this.#exports.memory.grow(Math.ceil(missing / PAGE));
    this.#top = begin + size;
    new Uint8Array(this.buffer, begin, size).fill(0);
    return begin;
  }

  #sizeOf(kind) {
    if (NUMBERS[kind]) return NUMBERS[kind][0].BYTES_PER_ELEMENT * NUMBERS[kind][1];
    const declared = this.declarations.structs[kind];
    if (!declared) throw new TypeError(`core.wasm has no type ${kind}`);
    return declared.size;
  }

  #argument(kind, given, name) {
    if (kind.endsWith("*")) return this.#pointer(kind.slice(0, -1), given, `argument ${name}`);
    if (kind === "int64_t") return BigInt(given);
    if (typeof given !== "number") throw new TypeError(`argument ${name}: ${typeof given} is no number`);
    return given;
  }

  #pointer(kind, given, name) {
    if (given === null) return 0;
    if (Number.isInteger(given)) return given;
    if (Array.isArray(given) || ArrayBuffer.isView(given)) return this.array(kind, given)[ADDRESS];
    if (given?.[KIND] !== kind) throw new TypeError(`${name}: ${given?.[KIND] ?? typeof given} is no ${kind}`);
    return given[ADDRESS];
  }

  /**
   * A class of views of a struct, with a property for each field: numbers (unsigned ones of 64 bits as BigInt); arrays
   * of numbers as typed arrays, to be taken anew once memory has been allocated; structs; addresses of pointers.
   */
  #structClass(kind, fields) {
    const core = this;
    class Struct {
      constructor(address) {
        this[ADDRESS] = address;
        Object.preventExtensions(this); // to set a field that does not exist is an error
      }
    }
    Struct.prototype[KIND] = kind;
    for (const [name, [fieldKind, offset, count, pointer]] of Object.entries(fields)) {
      const access = pointer
        ? core.#pointerAccess(fieldKind, offset, `${kind}.${name}`)
        : count === 1 && NUMBERS[fieldKind]?.[1] === 1
          ? core.#numberAccess(fieldKind, offset)
          : core.#partAccess(fieldKind, offset, count);
      Object.defineProperty(Struct.prototype, name, { ...access, enumerable: true });
    }
    return Struct;
  }

  #pointerAccess(kind, offset, name) {
    const core = this;
    return {
      get() {
        return new DataView(core.buffer).getUint32(this[ADDRESS] + offset, true);
      },
      set(given) {
        const address = core.#pointer(kind, given, name);
        new DataView(core.buffer).setUint32(this[ADDRESS] + offset, address, true);
      },
    };
  }

  #numberAccess(kind, offset) {
    const core = this;
    const Numbers = NUMBERS[kind][0];
    const encode = kind.endsWith("int64_t") ? BigInt : Number;
    const decode = kind === "uint64_t" ? (number) => number : Number;
    return {
      get() {
        return decode(new Numbers(core.buffer, this[ADDRESS] + offset, 1)[0]);
      },
      set(given) {
        new Numbers(core.buffer, this[ADDRESS] + offset, 1)[0] = encode(given);
      },
    };
  }

  #partAccess(kind, offset, count) {
    const core = this;
    return {
      get() {
        if (NUMBERS[kind] || count > 1) return new CoreArray(core, kind, this[ADDRESS] + offset, count).values;
        return core.at(kind, this[ADDRESS] + offset);
      },
    };
  }
}

/** Items of one kind in the module's memory. */
class CoreArray {
  #core;

  constructor(core, kind, address, length) {
    this.#core = core;
    this[KIND] = kind;
    this[ADDRESS] = address;
    this.length = length;
  }

  /** A typed array of numbers, to be taken anew once memory has been allocated; or an array of structs. */
  get values() {
    const kind = this[KIND], first = this[ADDRESS];
    if (NUMBERS[kind]) {
      const [Numbers, each] = NUMBERS[kind];
      return new Numbers(this.#core.buffer, first, this.length * each);
    }
    const { size } = this.#core.declarations.structs[kind];
    return Array.from({ length: this.length }, (_, i) => this.#core.at(kind, first + i * size));
  }
}
