/** Packings beside each other: what differs in their requests and figures, and their pictures, slices and plots. */
import { absolute } from "./address.js";
import { get } from "./api.js";
import { figurePart, mark, plotPart, requestPart } from "./compare-parts.js";
import { byId, h, replace } from "./dom.js";
import { report, shell } from "./shell.js";

/** Most packings that are compared. */
const MOST = 4;

/**
 * Reads what is known of a packing.
 * @param {string} id of its job
 * @param {number} i
 * @returns {Promise<import("./compare-parts.js").Packing>}
 */
async function packing(id, i) {
  const path = `/v1/jobs/${encodeURIComponent(id)}`;
  const [job, request, found] = await Promise.all([
    get(`${path}?overview=true`),
    get(`${path}/request`),
    get(`${path}/result/summary`),
  ]);
  const title = `${job.name ?? job.overview?.title ?? `Job ${id.slice(-8)}`}, seed ${job.seed}`;
  return { letter: "ABCD"[i] ?? "", title, job, request, report: found };
}

shell();
try {
  const ids = (new URLSearchParams(location.search).get("jobs") ?? "").split(",").filter(Boolean);
  if (ids.length < 2 || ids.length > MOST) {
    const jobs = h("a", { href: absolute("/jobs?state=succeeded") }, "list of jobs");
    replace(byId("compared"), h("p", {}, `Choose 2 to ${MOST} packings in the `, jobs, ", then Compare."));
  } else {
    const packings = await Promise.all(ids.map(packing));
    document.title = `${packings.map(({ title }) => title).join(" / ")} - Packstone`;
    replace(
      byId("compared"),
      h(
        "ul",
        { class: "who" },
        packings.map(({ letter, title, job }, i) =>
          h("li", {}, mark(i, letter), " ", h("a", { href: absolute(`/jobs/${job.id}`) }, h("bdi", {}, title))),
        ),
      ),
      h("div", { class: "columns" }, requestPart(packings), figurePart(packings)),
      h("div", { id: "views" }),
      h("div", { id: "slices" }),
      plotPart(packings),
    );
    const views = await import("./compare-views.js");
    const pictures = views.viewPart(packings);
    byId("views").append(pictures.element);
    byId("slices").append(views.slicePart(packings));
    await pictures.start();
  }
} catch (error) {
  report(error);
}
