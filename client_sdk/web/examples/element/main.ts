import "@terraport/client/element";

const scene = document.querySelector("terraport-scene")!;
const told = document.querySelector("#told")!;
// `?scene=URL` shows another one.
const asked = new URLSearchParams(location.search).get("scene");
if (asked !== null) scene.setAttribute("src", asked);

scene.addEventListener("landed", ({ detail }) => {
  told.textContent = `Landed: ${detail.plan?.totalTriangles.toLocaleString("en")} triangles within ${detail.radiusM} m.`;
});
