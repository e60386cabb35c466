// The state of the camera view, in the link too.

export const initial = () => ({
  scene: { source: "macbeth", illuminant: "A", mean_luminance_cd_m2: 40, distance_m: null, width_m: null, flicker: null, motion: null, options: {} },
  lens: { source: null, f_number: 8, focal_length_mm: 50, transmittance: 1, falloff: "none", transmittance_table: null, focus_distance_m: null, blur: null, relative_illumination: null, distortion: null, lateral_color: null, veiling_glare: null },
  sensor: { source: "nikon-d200", gain_setting: null, changes: {}, binning: null },
  capture: { exposure_s: 1 / 3, seed: 0, temperature_c: null, cells_per_pixel: 1, noise: true },
  brightness: 1,
});

export function toHash(view, content) {
  const bytes = new TextEncoder().encode(JSON.stringify(content));
  const text = btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
  return `#${view}=${text}`;
}

export function fromHash(hash) {
  const [view, text] = hash.replace(/^#/, "").split("=");
  if (!text) return { view, content: null };
  try {
    const bytes = Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (c) => c.charCodeAt(0));
    return { view, content: JSON.parse(new TextDecoder().decode(bytes)) };
  } catch {
    return { view, content: null };
  }
}

export function merged(content) {
  const state = initial();
  for (const part of ["scene", "lens", "sensor", "capture"]) Object.assign(state[part], content?.[part] ?? {});
  if (Number.isFinite(content?.brightness)) state.brightness = content.brightness;
  return state;
}
