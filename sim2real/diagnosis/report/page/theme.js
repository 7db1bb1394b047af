// Light or dark: as the system says until the button is used.
const root = document.documentElement;
const systemDark = matchMedia("(prefers-color-scheme: dark)");
const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : systemDark.matches);
const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();

const followTheme = (redraw) => {
  const button = document.getElementById("theme");
  const name = () => { button.textContent = isDark() ? "Light" : "Dark"; };
  button.hidden = false;
  button.addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    name();
    redraw();
  });
  systemDark.addEventListener("change", () => { name(); redraw(); });
  name();
};
