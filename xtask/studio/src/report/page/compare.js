// Two pictures over each other: which ones, and where the one ends and the other begins.
const [left, right] = document.querySelectorAll(".compare img");
const [pickLeft, pickRight] = document.querySelectorAll(".controls select");
const show = () => {
  left.src = pictures[pickLeft.value][1];
  right.src = pictures[pickRight.value][1];
};
for (const pick of [pickLeft, pickRight]) {
  pictures.forEach(([name], i) => pick.add(new Option(name, i)));
  pick.addEventListener("change", show);
}
pickRight.value = Math.min(1, pictures.length - 1);
const box = document.querySelector(".compare");
const slider = document.querySelector(".controls input[type=range]");
const slide = () => box.style.setProperty("--at", slider.value + "%");
slider.addEventListener("input", slide);
box.addEventListener("pointermove", (event) => {
  slider.value = (100 * event.offsetX) / box.clientWidth;
  slide();
});
document.querySelector(".controls input[type=checkbox]").addEventListener("change", (event) => {
  box.classList.toggle("difference", event.target.checked);
});
show();
slide();
