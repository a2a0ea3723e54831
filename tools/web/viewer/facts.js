// Facts about what is shown, as rows of name and value.

const bytes = (n) => (n < 10000 ? `${n} bytes` : n < 1e6 ? `${(n / 1e3).toFixed(1)} kB` : `${(n / 1e6).toFixed(2)} MB`);
const decibel = (x) => `${x.toFixed(1)} dB`;
const COMPONENTS = { diffuse: "diffuse", specular: "specular", combined: "both reflections together" };

/** Rows of a model that `open.js` made. */
export function factsOf(model) {
  const rows = [["File", model.name]];
  if (model.bytes) rows.push(["Size", bytes(model.bytes)]);
  if (model.gltf) {
    const { asset } = model.gltf;
    rows.push(["glTF", `${asset.version}${asset.generator ? `, ${asset.generator}` : ""}`]);
    if (asset.copyright) rows.push(["Copyright", asset.copyright]);
    rows.push(["Appearance", model.appearance ? "measured" : model.reason ? `none shown: ${model.reason}` : "none"]);
  }
  if (model.appearance) rows.push(...streamFacts(model.appearance));
  else if (model.triangles) rows.push(["Triangles", model.triangles.toLocaleString("en")]);
  return rows;
}

function streamFacts(appearance) {
  const { facts, views, progress } = appearance.file;
  const rows = [];
  const add = (name, value) => value && rows.push([name, value]);
  add("Title", facts.title);
  add("Licence", facts.licence);
  add("Format", `${facts.version}${facts.profile ? `, profile ${facts.profile}` : ""}`);
  const sizes = [...new Set(views.map(({ camera }) => `${camera.width} × ${camera.height}`))];
  add("Views", `${views.length}${sizes.length ? ` of ${sizes.slice(0, 3).join(", ")}` : ""}`);
  add("Photographs", facts.components.map((component) => COMPONENTS[component]).join(", "));
  const error = facts.statedError;
  if (error?.sum_psnr_db !== undefined) add("Stated error", decibel(error.sum_psnr_db));
  const { indices, sourceVertexCount } = appearance.source;
  add("Mesh", `${sourceVertexCount.toLocaleString("en")} vertices, ${(indices.length / 3).toLocaleString("en")} triangles`);
  if (appearance.surface) add("Surface", `${(appearance.surface.indices.length / 3).toLocaleString("en")} triangles`);
  if (appearance.atlasSize) add("Atlas", appearance.atlasSize.join(" × "));
  const lights = new Set(appearance.lightNumbers).size;
  add("Lights", appearance.relightable ? `known${lights > 1 ? `, ${lights} of them` : ""}` : "unknown: can't be relit");
  add("Units", facts.units);
  add("Decoded", `${appearance.decoded} of ${views.length} views, ${bytes(progress.received)} read`);
  const sections = facts.sections.map(({ tag, bytes: size }) => `${tag} ${bytes(size)}`);
  add("Sections", sections.join(", "));
  const known = ["title", "licence", "units", "achieved_error", "profile"];
  for (const [key, value] of Object.entries(facts.metadata)) {
    if (!known.includes(key) && ["string", "number"].includes(typeof value)) add(key.replaceAll("_", " "), String(value));
  }
  return rows;
}

/** Shows rows in a list of definitions. */
export function showFacts(list, rows) {
  list.replaceChildren(
    ...rows.flatMap(([name, value]) => {
      const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
      dt.textContent = name;
      dd.textContent = value;
      return [dt, dd];
    }),
  );
}
