// The switch between dark and light. Until it is used the page follows the system.
(() => {
  const root = document.documentElement;
  const button = document.getElementById('theme');
  const systemIsDark = matchMedia('(prefers-color-scheme: dark)');
  const isDark = () => (root.dataset.theme ? root.dataset.theme === 'dark' : systemIsDark.matches);
  const show = () => button.setAttribute('aria-pressed', String(isDark()));
  button.hidden = false;
  button.addEventListener('click', () => {
    root.dataset.theme = isDark() ? 'light' : 'dark';
    show();
    document.dispatchEvent(new Event('themechange'));
  });
  systemIsDark.addEventListener('change', () => {
    show();
    document.dispatchEvent(new Event('themechange'));
  });
  show();
})();
