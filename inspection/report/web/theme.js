// The switch between dark and light, which names what it switches to. Until it is used the page follows the system.
(() => {
  const root = document.documentElement;
  const button = document.getElementById('theme');
  const systemIsDark = matchMedia('(prefers-color-scheme: dark)');
  const isDark = () => (root.dataset.theme ? root.dataset.theme === 'dark' : systemIsDark.matches);
  const show = () => (button.textContent = isDark() ? 'Light' : 'Dark');
  button.addEventListener('click', () => {
    root.dataset.theme = isDark() ? 'light' : 'dark';
    show();
  });
  systemIsDark.addEventListener('change', show);
  button.hidden = false;
  show();
})();
