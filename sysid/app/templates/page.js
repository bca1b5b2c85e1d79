"use strict";
// What a person does on the page goes to the program as one message; elements say what with
// data-do. They stand in shadow roots, so that one listener for all follows the composed path.
let count = 0;
const recent = [];
let last = null;
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
  last = [what, value];
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
// Of the events of a field only clicks and inputs leave a shadow root. A text is sent when it is
// complete: when the field was left, Enter is pressed, or before anything else is sent.
const begun = new Set();
function isText(node) { return node.matches("input:not([type=checkbox]):not([type=range]), textarea"); }
function isLeft(node) { return !node.isConnected || node.getRootNode().activeElement !== node; }
function complete(all) {
  for (const node of begun) {
    if (!all && !isLeft(node)) continue;
    begun.delete(node);
    send(node.dataset.do, node.value);
  }
}
document.addEventListener("input", (event) => {
  const node = element(event, "input[data-do], select[data-do], textarea[data-do]");
  if (node === null) return;
  if (isText(node)) { begun.add(node); return; }
  complete(true);
  send(node.dataset.do, node.type === "checkbox" ? node.checked : node.value);
});
document.addEventListener("keydown", (event) => { if (event.key === "Enter") complete(true); }, true);
setInterval(() => complete(false), 150);
// --- keys: 1 to 8 are the screens, z takes a change back, y makes it again
function isTyping(event) {
  const node = element(event, "input, select, textarea");
  return node !== null && node.type !== "checkbox";
}
document.addEventListener("keydown", (event) => {
  if (isTyping(event) || event.ctrlKey || event.metaKey || event.altKey) return;
  if (/^[1-8]$/.test(event.key)) send("screen", event.key);
  else if (event.key === "z") send("undo");
  else if (event.key === "y") send("redo");
});
// A part of the page that is drawn anew keeps the focus on what was used last.
function find(root, wanted) {
  for (const node of root.querySelectorAll("*")) {
    if (node.dataset && node.dataset.do === wanted[0]
        && (node.dataset.value === undefined || node.dataset.value === wanted[1])) return node;
    if (node.shadowRoot) {
      const inner = find(node.shadowRoot, wanted);
      if (inner !== null) return inner;
    }
  }
  return null;
}
setInterval(() => {
  if (last === null || document.activeElement !== document.body) return;
  const node = find(document, last);
  if (node !== null) node.focus({ preventScroll: true });
  last = null;
}, 400);
// --- files
async function upload(files) {
  const written = [];
  for (const file of files) {
    send("upload-began", file.name);
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
    await new Promise((resolve) => setTimeout(resolve, 150));
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
