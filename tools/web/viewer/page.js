// What both pages have: messages, pictures to keep, the file they were opened for.

export const element = (id) => document.getElementById(id);

/** Says what went wrong, or with `note` what is worth knowing, until it is closed. */
export function say(title, text, note = false) {
  element("message").hidden = false;
  element("message").classList.toggle("note", note);
  element("message-title").textContent = title;
  element("message-text").textContent = text;
}

/** Closes the message. */
export const hush = () => (element("message").hidden = true);

/** Gives a picture to the visitor, named as the file that it shows. */
export function keep(picture, name = "picture") {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(picture);
  link.download = `${name.replace(/\.[^.]*$/, "")}.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** Whether a file of this name may hold an object. */
export const isObject = (name) => /\.(tsuya|glb|gltf)$/i.test(name);

function fileInAddress() {
  const file = new URLSearchParams(location.search).get("file");
  return file ? new URL(file, document.baseURI) : null;
}

/** Has a link to the other page name the file that this page's address names. */
export function passOn(link) {
  const address = fileInAddress();
  if (address) link.search = `?file=${encodeURIComponent(address.href)}`;
}

/** What the page was made for: the file in its address, or what `viewer.json` in the viewer's folder names; null where there is none. */
export async function wantedFile(folder) {
  const address = fileInAddress();
  if (address) return { address, name: decodeURIComponent(address.pathname.split("/").pop()) };
  const beside = new URL("viewer.json", folder);
  const description = await fetch(beside).then((answer) => (answer.ok ? answer.json() : null)).catch(() => null);
  return description?.file ? { address: new URL(description.file, beside), name: description.name } : null;
}
