// The theme asks for a file of this name, which Debian's MkDocs leaves out of it. Ours brings the
// current page's entry in the navigation into view.
document.addEventListener("DOMContentLoaded", () => {
  const current = document.querySelector(".wy-menu-vertical a.current");
  if (current) {
    current.scrollIntoView({ block: "center" });
  }
});
