// Palette for all kinds of colour vision (Okabe and Ito, 2008), and colours of the theme.
const PEOPLE = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#b8a800", "#8a6fd1"];
export const STAGES = ["#0072b2", "#56b4e9", "#009e73", "#b8a800", "#e69f00", "#d55e00", "#cc79a7", "#8a6fd1", "#7f8a96"];

export const colourOf = (id) => (id === null || id === undefined ? "#8d97a3" : PEOPLE[(id - 1) % PEOPLE.length]);

export function inkOn(colour) {
  const [r, g, b] = [1, 3, 5].map((k) => {
    const c = parseInt(colour.slice(k, k + 2), 16) / 255;
    return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.18 ? "#000000" : "#ffffff";
}

const style = getComputedStyle(document.documentElement);
export const css = (name) => style.getPropertyValue(`--${name}`).trim();
