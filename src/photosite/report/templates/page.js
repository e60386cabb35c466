// Tables: a click on a column's heading sorts the rows of each group, a button copies the table as tab-separated text.
(function () {
  "use strict";
  var digits = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  function number(text) {
    var plain = text.replace(/[\s\u00a0\u202f]/g, "").replace(/−/g, "-");
    var found = /^[<>(]*(-?\d+(?:\.\d+)?)/.exec(plain);
    if (!found) { return null; }
    var power = /×10(⁻?)([⁰¹²³⁴⁵⁶⁷⁸⁹]+)/.exec(plain), exponent = 0;
    if (power) {
      power[2].split("").forEach(function (digit) { exponent = 10 * exponent + digits.indexOf(digit); });
      exponent = power[1] ? -exponent : exponent;
    }
    return parseFloat(found[1]) * Math.pow(10, exponent);
  }
  function compare(a, b) {
    var one = number(a), two = number(b);
    if (one !== null && two !== null) { return one - two; }
    if (one !== null || two !== null) { return one === null ? 1 : -1; }
    return a.localeCompare(b);
  }
  function cell(row, column) { return row.cells[column] ? row.cells[column].textContent.trim() : ""; }
  function sort(table, column, down) {
    var body = table.tBodies[0], group = [];
    function place() {
      group.sort(function (a, b) { return (down ? -1 : 1) * compare(cell(a, column), cell(b, column)); });
      group.forEach(function (row) { body.appendChild(row); });
      group = [];
    }
    Array.prototype.slice.call(body.rows).forEach(function (row) {
      if (row.className === "heading") { place(); body.appendChild(row); } else { group.push(row); }
    });
    place();
  }
  function copy(table, button) {
    var text = Array.prototype.map.call(table.rows, function (row) {
      return Array.prototype.map.call(row.cells, function (c) { return c.textContent.trim().replace(/\s+/g, " "); }).join("\t");
    }).join("\n");
    function done() { button.textContent = "copied"; setTimeout(function () { button.textContent = "copy"; }, 1500); }
    function byHand() {
      var area = document.createElement("textarea");
      area.value = text;
      document.body.appendChild(area);
      area.select();
      document.execCommand("copy");
      area.remove();
      done();
    }
    if (navigator.clipboard) { navigator.clipboard.writeText(text).then(done, byHand); } else { byHand(); }
  }
  Array.prototype.forEach.call(document.querySelectorAll("table"), function (table) {
    var heads = table.tHead.rows[0].cells, button = document.createElement("button");
    button.type = "button";
    button.className = "copy";
    button.textContent = "copy";
    button.onclick = function () { copy(table, button); };
    table.caption.append(" ", button);
    if (table.tBodies[0].rows.length < 3) { return; }
    Array.prototype.forEach.call(heads, function (head, column) {
      function turn() {
        var down = head.getAttribute("aria-sort") === "ascending";
        Array.prototype.forEach.call(heads, function (other) { other.removeAttribute("aria-sort"); });
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        sort(table, column, down);
      }
      head.tabIndex = 0;
      head.classList.add("sortable");
      head.onclick = turn;
      head.onkeydown = function (event) { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); turn(); } };
    });
  });
}());
