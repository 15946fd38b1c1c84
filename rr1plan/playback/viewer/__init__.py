"""The 3-D page: one offline file, or live from a running program."""

from rr1plan.playback.viewer.capture import screenshot as screenshot
from rr1plan.playback.viewer.document import pack_array as pack_array
from rr1plan.playback.viewer.document import view_document as view_document
from rr1plan.playback.viewer.live import Viewer as Viewer
from rr1plan.playback.viewer.live import show as show
from rr1plan.playback.viewer.options import Panel as Panel
from rr1plan.playback.viewer.options import ViewOptions as ViewOptions
from rr1plan.playback.viewer.static import save_html as save_html
