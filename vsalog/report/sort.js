// A click on a heading sorts the table by that column, numbers as numbers; a second one the other way round. Blanks come last.
(() => {
  const table = document.querySelector("table");
  if (!table) return;
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, i) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const way = head.getAttribute("aria-sort") === "ascending" ? -1 : 1, numeric = head.classList.contains("n");
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
      const value = (text) => numeric && text !== "" ? parseFloat(text.replace("−", "-")) : text;
      const rows = [...body.rows].map((row) => [value(row.cells[i].textContent), row]);
      rows.sort(([a], [b]) => a === "" || b === "" ? (a === "") - (b === "") : way * (a < b ? -1 : a > b ? 1 : 0));
      body.append(...rows.map(([, row]) => row));
    });
  });
})();
