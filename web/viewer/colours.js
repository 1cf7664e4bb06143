// Colours of grains: viridis by size, on a logarithmic scale as sieves are, and sixteen steps of it for classes.
// @ts-check

/** Viridis (van der Walt and Smith, 2015) at 16 equal steps, as hexadecimal digits. */
const VIRIDIS = "440154481a6c472f7d41448739568c31688e2a788e23888e1f988b22a88435b77954c5687ad151a5db36d2e21bfde725";

/** Colours of aggregates, told apart with any kind of colour blindness (Okabe and Ito, 2008), twice. */
const OKABE = "e69f0056b4e9009e73f0e4420072b2d55e00cc79a7999999".repeat(2);

/** @param {string} text */
const parse = (text) =>
  Array.from({ length: 16 }, (_, i) => [0, 2, 4].map((k) => parseInt(text.slice(6 * i + k, 6 * i + k + 2), 16) / 255));

const steps = parse(VIRIDIS);

/**
 * Sixteen colours of which the first `count` are the steps of classes: without the darkest tenth of viridis, on which
 * shades cannot be told apart.
 * @param {number} count
 */
export const classes = (count) =>
  steps.map((_, step) => {
    const t = 1.5 + 13.5 * (count > 1 ? Math.min(1, step / (count - 1)) : 0.6);
    const i = Math.min(14, Math.floor(t));
    return steps[i].map((c, k) => c + (steps[i + 1][k] - c) * (t - i));
  });

/** Colours by size, at 16 equal steps. */
export const viridis = classes(16);

/** @type {number[][]} */
export const aggregates = parse(OKABE);

/** @param {number[]} colour */
export const css = (colour) => `rgb(${colour.map((c) => Math.round(255 * c)).join(" ")})`;
