"""The 3-D page: one offline file, or live from a running program."""

from rr1plan.playback.viewer.capture import screenshot as screenshot
from rr1plan.playback.viewer.document import pack as pack
from rr1plan.playback.viewer.document import view_document as view_document
from rr1plan.playback.viewer.live import Viewer as Viewer
from rr1plan.playback.viewer.live import show as show
from rr1plan.playback.viewer.page import Panel as Panel
from rr1plan.playback.viewer.static import save_html as save_html
