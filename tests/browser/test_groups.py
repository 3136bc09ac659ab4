"""Two people in one scene: one guides, the other follows."""

from __future__ import annotations

from collections.abc import Callable

from browser.driven_viewer import DrivenViewer
from browser.small_scenes import SMALL
from browser.watched_page import Watch, save_shot
from faults.service import Service
from playwright.sync_api import Page, expect

PLACE = (0.0, 2.0, 0.0)
NEXT = (60.0, 2.0, 30.0)
ROOM = {"viewport": {"width": 1000, "height": 700}}


def joined(viewer: DrivenViewer, name: str, role: str) -> Page:
    page = viewer.page
    viewer.open()
    page.click("[data-tab=places], #tab-places")
    page.fill("#group-name", "tour-1")
    page.fill("#group-own-name", name)
    page.click(f"#group-form [data-role={role}]")
    expect(page.locator("#group-title")).to_contain_text("tour-1")
    return page


def test_who_guides_takes_the_others_along(
    open_page: Callable[..., tuple[Page, Watch]], server: Service
) -> None:
    guide, follower = (DrivenViewer(open_page(**ROOM)[0], server.url, SMALL) for _ in range(2))
    leading = joined(guide, "Anna", "guide")
    following = joined(follower, "Ben", "member")
    # Both lists have both, by name.
    for page in (leading, following):
        expect(page.locator("#group-members li")).to_have_count(2)
    expect(leading.locator("#group-members")).to_contain_text("Anna (you), guide")
    expect(following.locator("#group-members")).to_contain_text("Anna, guide")
    expect(following.locator("[data-action=group-gather]")).to_be_hidden()

    # Where who has landed stands, and who has not is nowhere yet.
    guide.land(PLACE, 30.0)
    assert follower.visible == []
    assert leading.locator("[data-action=go-to-member]").count() == 0
    guide_row = following.locator("#group-members li", has_text="Anna")
    expect(guide_row.locator("[data-action=go-to-member]")).to_be_visible()
    leading.click("[data-action=group-gather]")
    # The guide is told when the other shows the same.
    expect(leading.locator("#group-members")).to_contain_text("came along")
    assert follower.visible == guide.visible != []
    save_shot(leading, "group-guide")
    save_shot(following, "group-follower")

    # Who does not follow stays, is told apart, and may come later.
    following.uncheck("#group-follows")
    before = follower.visible
    guide.land(NEXT, 30.0)
    leading.click("[data-action=group-gather]")
    expect(leading.locator("#group-members")).to_contain_text("elsewhere")
    assert follower.visible == before
    # 60 m east, 30 m south: as far as it is, and no other.
    expect(guide_row).to_contain_text("67 m south-east")
    expect(leading.locator("#group-members li", has_text="Ben")).to_contain_text("67 m north-west")
    save_shot(following, "group-where")
    # A click takes one there, with one's own radius, and the group hears of that, too.
    guide_row.locator("[data-action=go-to-member]").click()
    follower.until("JSON.stringify(terraport.state.landed?.place) === '[60,2,30]'")
    assert follower.run("terraport.state.landed.radiusM === terraport.state.radiusM")
    for page, name in ((following, "Anna"), (leading, "Ben")):
        row = page.locator("#group-members li", has_text=name)
        expect(row).to_contain_text("beside you")
    save_shot(following, "group-beside")
    following.click("[data-action=group-go]")
    shown = "JSON.stringify([...terraport.visible])"
    follower.until(f"{shown} === '{guide.run(shown)}'")

    # A second guide is refused, with the service's words.
    following.click("[data-action=group-leave]")
    expect(leading.locator("#group-members li")).to_have_count(1)
    following.click("#group-form [data-role=guide]")
    expect(following.locator("#group-problem")).to_contain_text("guide")
    expect(following.locator("#group-form")).to_be_visible()
