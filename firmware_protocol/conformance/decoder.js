// A decoder of the native protocol, from PROTOCOL.md alone: it shares nothing with the one in Python,
// and the tests compare what both make of the same bytes.
//
//     node decoder.js < cases.json      cases: [{"wire": "hex"}, ...]
//
// prints, for each case, what a host tells of it: descriptors, runs of samples with the times of
// their frames, losses, statuses, events, replies, and counters. Section numbers are those of PROTOCOL.md.
"use strict";

const LONGEST_CHUNK = 247;
const SHORTEST_FRAME = 12;
const MOST_SAMPLES = 18;
const MOST_HELD = 1024;
const MAJOR = 1;
const RANGE = 2 ** 32;
const NO_TICKS = 0xffffffff;
const [DATA, DESCRIPTOR, STATUS, EVENT, REPLY, HOST] = [0x01, 0x02, 0x03, 0x04, 0x06, 0x80];
const PING = 0x85;
const PING_TELLS_TIME = 2; // minor version
const LEAST_BODY = { [STATUS]: 32, [EVENT]: 9, [REPLY]: 4 };
const AXES = ["gx", "gy", "gz", "ax", "ay", "az"];

// --- section 1: bytes on the wire ----------------------------------------------------------

const CRC_TABLE = Array.from({ length: 256 }, (_, byte) => {
  let crc = byte;
  for (let bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
  return crc >>> 0;
});

function crc32(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) crc = (crc >>> 8) ^ CRC_TABLE[(crc ^ byte) & 0xff];
  return (crc ^ 0xffffffff) >>> 0;
}

// Undo COBS: the first byte is the distance to the first zero, each zero to the next.
function unstuffed(chunk) {
  const frame = Buffer.from(chunk);
  let here = 0;
  while (here < chunk.length) {
    const step = chunk[here];
    frame[here] = 0;
    here += step;
  }
  return here === chunk.length ? frame.subarray(1) : null;
}

// --- section 5: the descriptor ---------------------------------------------------------------

// A float stands for the shortest decimal that rounds to it.
function shortest(bytes, at = 0) {
  if (!bytes || bytes.length < at + 4) return null;
  const value = bytes.readFloatLE(at);
  if (!Number.isFinite(value)) return null;
  for (let digits = 1; digits <= 9; digits++) {
    const short = Number(value.toPrecision(digits));
    if (Math.fround(short) === value) return short;
  }
  return value;
}

function entriesOf(body) {
  const entries = new Map();
  let at = 1;
  while (at < body.length) {
    if (body.length - at < 2 || body[at + 1] > body.length - at - 2) return null;
    entries.set(body[at], body.subarray(at + 2, at + 2 + body[at + 1]));
    at += 2 + body[at + 1];
  }
  return entries;
}

function describedBy(body, epoch) {
  const entries = body.length && body[0] === 1 ? entriesOf(body) : null;
  if (!entries) return null;
  const mask = entries.has(0x0c) ? entries.get(0x0c)[0] || 0 : 0x3f;
  const columns = [0, 1, 2, 3, 4, 5].filter((bit) => (mask >> bit) & 1);
  const scale = columns.map((i) => shortest(entries.get(i < 3 ? 0x06 : 0x08)));
  if (!columns.length || scale.some((one) => !(one > 0))) return null;
  const clock = entries.get(0x0d);
  const tick = entries.get(0x0b);
  return {
    epoch,
    columns,
    scale,
    valid: (mask & 0x07 ? 1 : 0) | (mask & 0x38 ? 2 : 0),
    rate: Math.max(shortest(entries.get(0x0a)) || 0, 0),
    hasClock: !(clock && clock.length === 1 && clock[0] === 0),
    tickNs: (tick && tick.length === 4 && tick.readUInt32LE(0)) || 25000,
  };
}

// --- sections 6 and 7: what a device says beside its samples ---------------------------------

const COUNTERS = ["produced", "sent", "dropped", "overruns", "commands", "bad_commands"];

function seconds(body, at) {
  return Number(body.readBigUInt64LE(at)) / 1e6;
}

// A later minor version may append fields to a status and to a reply.
function saidBy(type, minor, body) {
  if (type === STATUS) {
    const counters = COUNTERS.map((name, i) => [name, body.readUInt32LE(8 + 4 * i)]);
    return { status: { time: seconds(body, 0), ...Object.fromEntries(counters) } };
  }
  if (type === EVENT) {
    return { event: { time: seconds(body, 0), level: body[8], text: body.toString("utf8", 9) } };
  }
  const [seq, command, result] = [body.readUInt16LE(0), body[2], body[3]];
  const timed = command === PING && minor >= PING_TELLS_TIME && body.length >= 4 + 8;
  return { reply: { seq, command, result, time: timed ? seconds(body, body.length - 8) : null } };
}

// --- sections 8 and 9: what a host tells -----------------------------------------------------

class Decoder {
  constructor() {
    this.events = [];
    this.counters = { frames: 0, damaged: 0, unknown: 0, samples: 0, lost: 0, unknown_losses: 0 };
    this.known = null;
    this.held = [];
    this.nextSeq = null;
    this.framesMissing = false;
    this.nextIndex = null;
    this.lastFrame = null;
    this.due = null;
    this.delivered = false;
    this.ticks = null;
  }

  feed(bytes) {
    let start = 0;
    for (let end = bytes.indexOf(0); end >= 0; end = bytes.indexOf(0, start)) {
      this.chunk(bytes.subarray(start, end));
      start = end + 1;
    }
  }

  chunk(chunk) {
    if (!chunk.length) return;
    const frame = chunk.length <= LONGEST_CHUNK ? unstuffed(chunk) : null;
    const sound =
      frame &&
      frame.length >= SHORTEST_FRAME &&
      crc32(frame.subarray(0, -4)) === frame.readUInt32LE(frame.length - 4);
    if (!sound) this.counters.damaged++;
    else this.frame(frame.subarray(0, -4));
  }

  frame(frame) {
    const [type, version, n] = [frame[0], frame[1], frame[7]];
    if (version >> 4 !== MAJOR) {
      this.counters.unknown++; // nothing but the version can be believed, so not seq either
      return;
    }
    const isData = type === DATA && n >= 1 && n <= MOST_SAMPLES && frame.length === 26 + 12 * n;
    if (type < HOST) this.noteSeq(frame.readUInt16LE(2));
    if (isData) this.data(frame);
    else if (type === DESCRIPTOR) this.described(frame);
    else if (LEAST_BODY[type] <= frame.length - 8 && n === frame.length - 8) {
      this.counters.frames++;
      this.events.push(saidBy(type, version & 15, frame.subarray(8)));
    } else this.counters.unknown++;
  }

  noteSeq(seq) {
    if (this.nextSeq !== null && seq !== this.nextSeq) this.framesMissing = true;
    this.nextSeq = (seq + 1) & 0xffff;
  }

  described(frame) {
    const epoch = frame.readUInt16LE(4);
    const known = describedBy(frame.subarray(8), epoch);
    if (!known) {
      this.counters.unknown++;
      return;
    }
    this.counters.frames++;
    if (JSON.stringify(known) === JSON.stringify(this.known)) return;
    this.known = known;
    this.nextIndex = this.lastFrame = this.ticks = null;
    if (this.delivered && this.due === null) this.due = "restarted";
    const axes = known.columns.map((i) => AXES[i]);
    this.events.push({ epoch, axes, scale: known.scale, rate: known.rate });
    const held = this.held;
    this.held = [];
    for (const [data, missing] of held) {
      if (data.readUInt16LE(4) === epoch) this.deliver(data, missing);
    }
  }

  data(frame) {
    this.counters.frames++;
    const missing = this.framesMissing;
    this.framesMissing = false;
    if (this.known && this.known.epoch === frame.readUInt16LE(4)) {
      this.deliver(frame, missing);
      return;
    }
    this.held.push([frame, missing]);
    if (this.held.length > MOST_HELD) this.held.shift(); // the oldest makes room
  }

  deliver(frame, missing) {
    const [seq, index] = [frame.readUInt16LE(2), frame.readUInt32LE(8)];
    const [flags, n] = [frame[6], frame[7]];
    if (this.lastFrame && this.lastFrame[0] === seq && this.lastFrame[1] === index) {
      this.counters.damaged++; // a second copy
      return;
    }
    if ((flags & 3) !== this.known.valid) return; // its samples will be missing by their index
    const first = this.follow(index, missing, flags & 4);
    const rows = [];
    for (let row = 0; row < n; row++) {
      rows.push(this.known.columns.map((i) => frame.readInt16LE(26 + 12 * row + 2 * i)));
    }
    const last = this.events[this.events.length - 1];
    if (last && last.counts && last.index + last.counts.length === first) {
      last.counts.push(...rows);
      last.times.push(this.time(frame));
    } else {
      this.events.push({ index: first, counts: rows, times: [this.time(frame)] });
    }
    this.nextIndex = first + n;
    this.lastFrame = [seq, index];
    this.delivered = true;
    this.counters.samples += n;
  }

  // Return the unwrapped index, and tell what is missing before it.
  follow(index, missing, overrun) {
    const due = this.due;
    this.due = null;
    if (this.nextIndex === null) {
      if (due) this.gap(due, null);
      return index;
    }
    const jump = (((index - this.nextIndex) % RANGE) + RANGE) % RANGE;
    if (jump >= RANGE / 2) {
      this.gap(due || "restarted", null);
      return index;
    }
    if (jump || due) this.gap(due || (missing ? "link" : overrun ? "sensor" : "device"), jump);
    return this.nextIndex + jump;
  }

  gap(reason, lost) {
    this.counters.lost += lost || 0;
    this.counters.unknown_losses += lost === null ? 1 : 0;
    this.events.push({ lost, reason });
  }

  time(frame) {
    if (this.known.hasClock) return Number(frame.readBigUInt64LE(12)) / 1e6;
    const stamp = frame.readUInt32LE(20);
    if (stamp === NO_TICKS) return null;
    const [raw, total] = this.ticks || [stamp, stamp];
    const now = total + ((((stamp - raw) % RANGE) + RANGE) % RANGE);
    this.ticks = [stamp, now];
    return now * (this.known.tickNs * 1e-9);
  }
}

function told(wire) {
  const decoder = new Decoder();
  decoder.feed(Buffer.from(wire, "hex"));
  return { events: decoder.events, counters: decoder.counters };
}

const cases = JSON.parse(require("fs").readFileSync(0, "utf8"));
console.log(JSON.stringify(cases.map((one) => told(one.wire))));
