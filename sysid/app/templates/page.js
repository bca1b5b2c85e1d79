"use strict";
// What a person does on the page goes to the program as one message; elements say what with
// data-do. They stand in shadow roots, so that one listener for all follows the composed path.
let count = 0;
const recent = [];
function asked() {
  for (const doc of Bokeh.documents) {
    const model = doc.get_model_by_name("asked");
    if (model !== null) return model;
  }
  return null;
}
function send(what, value) {
  const model = asked();
  if (model === null) return;
  if (what === "screen") scrollTo(0, 0);
  count += 1;
  recent.push({ do: what, value: value ?? null, count });
  if (recent.length > 40) recent.shift();
  // Values that follow one another quickly may reach the program as the last one alone: each
  // brings those before it, and the program does what it has not done yet.
  model.value = JSON.stringify(recent);
}
function element(event, kind) {
  for (const node of event.composedPath()) {
    if (node instanceof Element && node.matches(kind)) return node;
  }
  return null;
}
document.addEventListener("click", (event) => {
  const node = element(event, "button[data-do]");
  if (node === null || node.disabled) return;
  if (node.dataset.do === "cancel" && event.detail > 0) return; // sent when it was pressed
  complete(true);
  if (node.dataset.do === "scheme") {
    const other = document.documentElement.dataset.scheme === "dark" ? "light" : "dark";
    localStorage.setItem("sysid-scheme", other);
    const to = new URL(location.href);
    to.searchParams.set("scheme", other);
    location.replace(to);
    return;
  }
  if (node.dataset.do === "choose-file") { pick(); return; }
  send(node.dataset.do, node.dataset.value);
});
// The bar of a job is drawn anew while it runs: a button that goes between press and release would
// hear no click.
document.addEventListener("pointerdown", (event) => {
  if (element(event, "button[data-do=cancel]") !== null) send("cancel");
});
// --- what has the focus: a part of the page may be drawn anew at any time, under one's typing too.
// The element that stands for the one that went takes its place, with the text and the caret.
let held = null;
const begun = new Set(); // fields whose text is not complete yet
function isText(node) { return node.matches("input:not([type=checkbox]):not([type=range]), textarea"); }
function focused() {
  let node = document.activeElement;
  while (node?.shadowRoot?.activeElement) node = node.shadowRoot.activeElement;
  return node;
}
function successor(node, root = document) {
  for (const other of root.querySelectorAll("*")) {
    if (other.dataset?.do === node.dataset.do && other.dataset.value === node.dataset.value
        && other.localName === node.localName) return other;
    const inner = other.shadowRoot ? successor(node, other.shadowRoot) : null;
    if (inner !== null) return inner;
  }
  return null;
}
function follow() {
  const now = focused();
  if (now !== document.body) held = now?.dataset?.do ? now : null;
  for (const node of begun) {
    const next = node.isConnected ? null : successor(node);
    if (next === null) continue; // it is there still, or not drawn yet
    begun.delete(node);
    next.value = node.value;
    begun.add(next);
  }
  if (held === null || now !== document.body || !document.hasFocus()) return;
  const next = held.isConnected ? held : successor(held); // one that was moved loses the focus too
  if (next === null) return;
  next.focus({ preventScroll: true });
  if (next.type === "text") next.setSelectionRange(held.selectionStart, held.selectionEnd);
  held = next;
}
document.addEventListener("pointerdown", () => { held = null; }, true);
// Movements of the focus within a shadow root are not heard of outside: it is looked at, after each
// drawing, and before a key is taken as a letter or as a command of the page.
(function watch() { follow(); requestAnimationFrame(watch); })();
document.addEventListener("keydown", (event) => {
  follow();
  // Of a field that goes next, what is selected counts for what is typed.
  if (isCommand(event) && event.key === "a" && held !== null && isText(held)) held.select();
}, true);
// The letter of a key comes after the key was pressed: the field may have gone in between.
document.addEventListener("keypress", (event) => {
  const meant = focused();
  follow();
  if (held === null || held === meant || !isText(held)) return;
  if (event.key.length !== 1 || isCommand(event)) return;
  held.setRangeText(event.key, held.selectionStart, held.selectionEnd, "end");
  begun.add(held);
  event.preventDefault();
}, true);
// Of the events of a field only clicks and inputs leave a shadow root. A text is sent when it is
// complete: when the field was left, Enter is pressed, or before anything else is sent.
function complete(all) {
  follow();
  for (const node of begun) {
    if (!all && (node === held || !node.isConnected)) continue;
    begun.delete(node);
    send(node.dataset.do, node.value);
  }
}
// A tick with Shift is that of all between, where a list of them says so; of a label's click the box
// hears one with the same keys, before its input.
let isShifted = false;
document.addEventListener("click", (event) => { isShifted = event.shiftKey; }, true);
document.addEventListener("input", (event) => {
  const node = element(event, "input[data-do], select[data-do], textarea[data-do]");
  if (node === null) return;
  if (isText(node)) { begun.add(node); return; }
  complete(true);
  const isSpan = node.type === "checkbox" && isShifted && element(event, "[data-span]") !== null;
  send(node.dataset.do + (isSpan ? ":span" : ""), node.type === "checkbox" ? node.checked : node.value);
});
document.addEventListener("keydown", (event) => { if (event.key === "Enter") complete(true); }, true);
setInterval(() => complete(false), 150);
// --- keys: 1 to 8 are the screens, z takes a change back, y makes it again
function isCommand(event) { return event.ctrlKey || event.metaKey || event.altKey; }
function isTyping() {
  const node = held ?? focused();
  return node.matches("input, select, textarea") && node.type !== "checkbox";
}
document.addEventListener("keydown", (event) => {
  if (isTyping() || isCommand(event)) return;
  if (/^[1-8]$/.test(event.key)) send("screen", event.key);
  else if (event.key === "z") send("undo");
  else if (event.key === "y") send("redo");
});
// --- files
async function upload(files) {
  const written = [];
  let told = -Infinity;
  for (const file of files) {
    if (performance.now() - told > 300) { // of many short files not each
      told = performance.now();
      send("upload-began", file.name);
    }
    let text = "";
    let ok = false;
    try {
      const answer = await fetch("upload/" + encodeURIComponent(file.name), {
        method: "PUT", body: file, credentials: "same-origin",
      });
      text = await answer.text();
      ok = answer.ok;
    } catch (error) {
      text = file.name + ": was refused while it was sent; is it too long?";
    }
    if (ok) written.push(text);
    else send("upload-refused", text);
  }
  if (written.length) send("uploaded", written);
}
function pick() {
  const input = document.createElement("input");
  input.type = "file";
  input.multiple = true;
  input.addEventListener("change", () => upload(input.files));
  input.click();
}
document.addEventListener("dragover", (event) => {
  event.preventDefault();
  document.documentElement.classList.add("dropping");
});
document.addEventListener("dragleave", (event) => {
  if (event.relatedTarget === null) document.documentElement.classList.remove("dropping");
});
document.addEventListener("drop", (event) => {
  event.preventDefault();
  document.documentElement.classList.remove("dropping");
  upload(event.dataTransfer.files);
});
// --- the program's end
let missed = 0;
setInterval(async () => {
  try {
    const answer = await fetch("alive", { credentials: "same-origin", cache: "no-store" });
    missed = answer.ok ? 0 : missed + 1;
  } catch (error) { missed += 1; }
  document.getElementById("gone").hidden = missed < 2;
}, 3000);
