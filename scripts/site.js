const box = document.querySelector('nav input');
const found = document.querySelector('#found');
const groups = document.querySelector('#groups');
box.addEventListener('input', () => {
  const words = box.value.toLowerCase().split(/\s+/).filter(Boolean);
  groups.hidden = words.length > 0; found.replaceChildren();
  if (!words.length) return;
  for (const [text, url] of INDEX.filter(
      ([text]) => words.every(w => text.toLowerCase().includes(w))).slice(0, 40)) {
    const a = document.createElement('a');
    a.textContent = text; a.href = UP + url; found.append(a);
  }
});
if (matchMedia('(max-width: 760px)').matches)
  document.querySelectorAll('#groups details').forEach(d => d.open = false);
