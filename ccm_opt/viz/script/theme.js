// The choice of light and dark; by default that of the reader's system.

function startTheme() {
  const themes = ["auto", "light", "dark"];
  const button = byId("theme");
  let current = "auto";
  try {
    current = localStorage.getItem("ccm-opt-theme") ?? "auto";
  } catch {
    // A page from a file may not be allowed to remember anything.
  }
  const show = () => {
    document.documentElement.dataset.theme = current;
    button.textContent = { auto: "◐ auto", light: "○ light", dark: "● dark" }[current];
  };
  button.addEventListener("click", () => {
    current = themes[(themes.indexOf(current) + 1) % themes.length];
    try {
      localStorage.setItem("ccm-opt-theme", current);
    } catch {
      // Then it is forgotten with the page.
    }
    show();
  });
  show();
}
