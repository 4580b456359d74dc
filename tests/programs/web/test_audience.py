"""Queues of browsers: in order, bounded, and independent of each other."""

import asyncio

from programs.web.audience import MOST_WAITING, Audience, Browser


def taken(browser: Browser, count: int) -> list[str | bytes]:
    async def take() -> list[str | bytes]:
        async with asyncio.timeout(5):
            return [await browser.next() for _ in range(count)]

    return asyncio.run(take())


def test_frames_come_in_order_and_texts_before_them() -> None:
    browser = Browser()
    for i in range(3):
        browser.frame(bytes([i]))
    browser.text("first")
    browser.text("second")
    assert taken(browser, 5) == ["first", "second", b"\x00", b"\x01", b"\x02"]


def test_a_slow_client_loses_the_oldest_frames_and_no_other_does() -> None:
    audience, slow, quick = Audience(), Browser(), Browser()
    audience.add(slow)
    audience.add(quick)
    for i in range(MOST_WAITING + 40):
        audience.frame(bytes([i]))
        assert taken(quick, 1) == [bytes([i])]
    assert slow.left_out == 40
    assert quick.left_out == 0
    assert taken(slow, MOST_WAITING) == [bytes([i]) for i in range(40, MOST_WAITING + 40)]
    audience.remove(slow)
    audience.text("gone")
    assert taken(quick, 1) == ["gone"]
