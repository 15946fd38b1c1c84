"""The 3-D page: one offline file, or live from a running program."""

from rr1plan.playback.viewer.html_file import save_html as save_html
from rr1plan.playback.viewer.live_viewer import Viewer as Viewer
from rr1plan.playback.viewer.live_viewer import show as show
from rr1plan.playback.viewer.page_arrays import pack_array as pack_array
from rr1plan.playback.viewer.page_capture import screenshot as screenshot
from rr1plan.playback.viewer.page_document import view_document as view_document
from rr1plan.playback.viewer.page_video import save_video as save_video
from rr1plan.playback.viewer.view_options import Panel as Panel
from rr1plan.playback.viewer.view_options import ViewOptions as ViewOptions
