/* What the page carries: a JSON head, and columns of integers in one deflated, base64-encoded block.
   A column is rows of equal length; each row holds differences (of the given order) modulo the word size,
   zigzag-coded, and the bytes lie plane by plane. `Columns` of page.py writes the inverse. */

export function bytesOfBase64(text) {
  text = text.trim();
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

export async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function decodeColumn(column, bytes) {
  const { offset, rows, length, size, order } = column;
  const count = rows * length;
  const Words = { 1: Uint8Array, 2: Uint16Array, 4: Uint32Array }[size];
  const words = new Words(count);
  for (let plane = 0; plane < size; plane++) {
    const begin = offset + plane * count, shift = 8 * plane;
    for (let i = 0; i < count; i++) words[i] |= bytes[begin + i] << shift;
  }
  if (order === 0) return words;
  for (let i = 0; i < count; i++) words[i] = (words[i] >>> 1) ^ -(words[i] & 1);
  for (let pass = 0; pass < order; pass++) {
    for (let row = 0; row < rows; row++) {
      const end = (row + 1) * length;
      for (let i = row * length + 1; i < end; i++) words[i] += words[i - 1];
    }
  }
  return words;
}

export async function readRun() {
  const take = (id) => {
    const element = document.getElementById(id);
    const text = element.textContent;
    element.remove(); // megabytes of text that nothing needs again
    return text;
  };
  const run = JSON.parse(take("run-head"));
  const bytes = await inflate(bytesOfBase64(take("run-data")));
  run.columns = {};
  for (const column of run.manifest) run.columns[column.name] = decodeColumn(column, bytes);
  const { long, ...columns } = run.columns; // what is long of the head
  return { ...run, ...JSON.parse(new TextDecoder().decode(long)), columns };
}
