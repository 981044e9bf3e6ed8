// Mends of the theme. The sidebar shows the page that is open instead of the place where it stood before.
addEventListener('pagehide', () => sessionStorage.removeItem('sidebar-scroll-top'));

// Names for screen readers that begin with what one reads, and names of folds that have none.
document.addEventListener('DOMContentLoaded', () => {
    for (const one of document.querySelectorAll('.search-button__button, details.hide > summary')) {
        one.removeAttribute('aria-label');
    }
    for (const one of document.querySelectorAll('.bd-sidebar-primary summary')) {
        one.setAttribute('aria-label', `Pages below ${one.parentElement.previousElementSibling.textContent}`);
    }
});

// A table that is wider than its place is scrolled by keys, too.
function letScroll() {
    for (const one of document.querySelectorAll('.pst-scrollable-table-container')) {
        one.tabIndex = one.scrollWidth > one.clientWidth ? 0 : -1;
    }
}
addEventListener('load', letScroll);
addEventListener('resize', letScroll);
