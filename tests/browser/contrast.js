// The visible texts whose contrast to their background is below that of WCAG AA: 4.5:1, and 3:1 if large or a symbol.
() => {
  const numbers = (color) => { const found = color.match(/[\d.]+/g).map(Number); return found.length > 3 ? found : [...found, 1]; };
  const over = ([r, g, b, a], below) => [r, g, b].map((v, i) => a * v + (1 - a) * below[i]);
  const linear = (v) => (v <= 10 ? v / 3294.6 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const background = (node) => {
    const layers = [];
    for (let at = node; at; at = at.parentElement) {
      layers.push(numbers(at.id === "stage" ? "rgb(228, 232, 237)" : getComputedStyle(at).backgroundColor)); // the darker part of its gradient
    }
    return layers.reverse().reduce((below, layer) => over(layer, below), [255, 255, 255]);
  };
  const faint = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.data.trim(), node = walker.currentNode.parentElement, style = getComputedStyle(node);
    if (!text || node.closest(":disabled") || !node.checkVisibility({ visibilityProperty: true })) continue;
    const below = background(node), pair = [over(numbers(style.color), below), below].map(luminance).sort((a, b) => a - b);
    const ratio = (pair[1] + 0.05) / (pair[0] + 0.05), large = parseFloat(style.fontSize) >= 24 || !/[\p{L}\p{N}]/u.test(text);
    if (ratio < (large ? 3 : 4.5)) faint.push(`${text} (${node.tagName}.${node.className}): ${ratio.toFixed(2)}`);
  }
  return faint;
}
