"""What several pages show. No part knows a page or the context of one."""
