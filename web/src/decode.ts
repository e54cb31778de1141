// Numbers that the page holds as base64. Browsers run on little-endian machines only.

/** Decodes base64 into bytes. */
export function bytesOf(base64: string): Uint8Array<ArrayBuffer> {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let index = 0; index < text.length; index++) bytes[index] = text.charCodeAt(index);
  return bytes;
}

/** Decodes base64 of little-endian 16-bit integers. */
export function int16Of(base64: string): Int16Array {
  return new Int16Array(bytesOf(base64).buffer);
}

/** Decodes base64 of little-endian unsigned integers: of 32 bits where wide, else of 16. */
export function indicesOf(base64: string, wide: boolean): Uint16Array | Uint32Array {
  const { buffer } = bytesOf(base64);
  return wide ? new Uint32Array(buffer) : new Uint16Array(buffer);
}
